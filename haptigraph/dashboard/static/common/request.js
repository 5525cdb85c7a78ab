/** Requests to the server, in JSON; a failure becomes an error with one sentence. */

/** The server refused a request; `message` is the sentence to show. */
export class RequestError extends Error {}

/** The server or its store does not respond, or not yet; retrying may help. */
export class NoResponse extends RequestError {
  constructor(message = "The server does not respond; check that haptigraph is still running.") { super(message); }
}

/** Send a GET request, or a POST request if there is a body.
 *  @param {string} path @param {object} [body]
 *  @returns {Promise<any>}
 *  @throws {RequestError} */
export async function request(path, body) {
  let response, data;
  try {
    response = await fetch(path, body && {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), keepalive: path.endsWith("/answer"),
    });
  } catch {
    throw new NoResponse();
  }
  try {
    data = await response.json();
  } catch {
    throw new RequestError(`The server failed (status ${response.status}); see the terminal.`);
  }
  if (response.status === 503) throw new NoResponse(data.problem);
  if (!response.ok) throw new RequestError(data.problem ?? `refused (${response.status})`);
  return data;
}
