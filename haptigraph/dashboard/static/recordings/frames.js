/** Ask the server for work that takes a while: it answers in frames of JSON and bytes. */

/**
 * Yield [content, bytes] of every frame of an answer.
 *
 * @param {string} path
 * @param {Record<string, string> | string[][]} parameters
 * @param {AbortSignal} [signal] ends the work
 * @throws {Error} with the server's sentence
 */
export async function* frames(path, parameters, signal) {
  const { body } = await asked(path, parameters, signal);
  const source = new Bytes(body.getReader());
  while (true) {
    const head = await source.take(4);
    if (!head) return;
    const text = await source.take(new DataView(head.buffer).getUint32(0));
    const content = JSON.parse(new TextDecoder().decode(text));
    if (content.type === "problem") throw new Error(content.problem);
    yield [content, await source.take(content.bytes)];
  }
}

/** Fetch; what the server refuses becomes an error with its sentence. */
export async function asked(path, parameters, signal) {
  let answer;
  try {
    answer = await fetch(`${path}?${new URLSearchParams(parameters)}`, { signal, cache: "no-store" });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("The server does not answer.");
  }
  if (answer.ok) return answer;
  const text = await answer.text();
  throw new Error(text.startsWith("{") ? JSON.parse(text).problem : text);
}

/** Cut typed columns, as `content.columns` describes them, out of a frame's bytes. */
export function columnsOf(content, bytes) {
  const types = { f8: Float64Array, f4: Float32Array, u2: Uint16Array };
  const columns = {};
  let at = bytes.byteOffset;
  for (const [name, type, length] of content.columns) {
    const end = at + length * types[type].BYTES_PER_ELEMENT;
    columns[name] = new types[type](bytes.buffer.slice(at, end));
    at = end;
  }
  return columns;
}

class Bytes {
  constructor(reader) { this.reader = reader; this.parts = []; this.length = 0; }

  /** Return the next `wanted` bytes; null at the end. */
  async take(wanted) {
    while (this.length < wanted) {
      const { done, value } = await this.reader.read();
      if (done && this.length === 0) return null;
      if (done) throw new Error("The server broke off.");
      this.parts.push(value);
      this.length += value.length;
    }
    const taken = new Uint8Array(wanted);
    let filled = 0;
    while (filled < wanted) {
      const part = this.parts[0], piece = part.subarray(0, wanted - filled);
      taken.set(piece, filled);
      filled += piece.length;
      if (piece.length < part.length) this.parts[0] = part.subarray(piece.length); else this.parts.shift();
    }
    this.length -= wanted;
    return taken;
  }
}
