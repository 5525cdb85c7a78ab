/** Ask the server in JSON. Every answer that is no success is a sentence. */

/** Something the server refused; `message` is the sentence to show. */
export class Refused extends Error {
  constructor(message, exists = false) { super(message); this.exists = exists; }
}

/** Nobody answers, or not now: the server or its store is gone, or not there yet. It is worth asking again. */
export class NoAnswer extends Refused {
  constructor(message = "The server does not answer; is haptigraph still running?") { super(message); }
}

/**
 * Ask for something, or with `content` for something to be done.
 *
 * @throws {Refused}
 */
export async function ask(path, content) {
  let answer, data;
  try {
    answer = await fetch(path, content && {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content), keepalive: path.endsWith("/answer"),
    });
  } catch {
    throw new NoAnswer();
  }
  try {
    data = await answer.json();
  } catch {
    throw new Refused(`The server could not do that (${answer.status}); the terminal says why.`);
  }
  if (answer.status === 503) throw new NoAnswer(data.problem);
  if (!answer.ok) throw new Refused(data.problem ?? `refused (${answer.status})`, data.exists === true);
  return data;
}
