/** Requests for work that takes a while: the server answers with a stream of messages, each JSON and bytes. */

const BROKEN_OFF = "The server closed the connection early; try again.";

/** Yield the messages of an answer.
 *  @param {string} path @param {Record<string, string> | string[][]} parameters @param {AbortSignal} signal ends the work
 *  @returns {AsyncGenerator<[content: any, bytes: Uint8Array<ArrayBuffer>], void>}
 *  @throws {Error} with the server's sentence */
export async function* messages(path, parameters, signal) {
  const { body } = await get(path, parameters, signal);
  if (!body) throw new Error(BROKEN_OFF);
  const source = new ByteReader(body.getReader());
  while (true) {
    const head = await source.take(4);
    if (!head) return;
    const text = await source.take(new DataView(head.buffer).getUint32(0));
    const content = JSON.parse(new TextDecoder().decode(text ?? undefined));
    if (content.type === "problem") throw new Error(content.problem);
    yield [content, await source.take(content.bytes) ?? new Uint8Array()];
  }
}

/** Fetch; a refusal becomes an error with its sentence. @param {string} path @param {Record<string, string> | string[][]} parameters @param {AbortSignal} [signal] */
export async function get(path, parameters, signal) {
  let response;
  try {
    response = await fetch(`${path}?${new URLSearchParams(parameters)}`, { signal, cache: "no-store" });
  } catch (error) {
    if (isAbort(error)) throw error;
    throw new Error("The server does not respond.", { cause: error });
  }
  if (response.ok) return response;
  const text = await response.text();
  throw new Error(text.startsWith("{") ? JSON.parse(text).problem : text);
}

/** Return whether a request was aborted by this page. @param {unknown} error */
export function isAbort(error) { return error instanceof DOMException && error.name === "AbortError"; }

/** Cut the columns that `content.columns` describes out of a message's bytes. @param {RunContent} content @param {Uint8Array<ArrayBuffer>} bytes */
export function columnsOf(content, bytes) {
  const types = { f8: Float64Array, f4: Float32Array, u2: Uint16Array };
  const columns = /** @type {Columns} */ ({});
  let at = bytes.byteOffset;
  for (const [name, type, length] of content.columns) {
    const end = at + length * types[type].BYTES_PER_ELEMENT;
    columns[name] = new types[type](bytes.buffer.slice(at, end));
    at = end;
  }
  return columns;
}

class ByteReader {
  /** @type {Uint8Array[]} */ parts = [];
  length = 0;

  constructor(/** @type {ReadableStreamDefaultReader<Uint8Array>} */ reader) { this.reader = reader; }

  /** Return the next bytes; null at the end of the stream. @param {number} count */
  async take(count) {
    while (this.length < count) {
      const { done, value } = await this.reader.read();
      if (done && this.length === 0) return null;
      if (done) throw new Error(BROKEN_OFF);
      this.parts.push(value);
      this.length += value.length;
    }
    const taken = new Uint8Array(count);
    let filled = 0;
    while (filled < count) {
      const part = this.parts[0], piece = part.subarray(0, count - filled);
      taken.set(piece, filled);
      filled += piece.length;
      if (piece.length < part.length) this.parts[0] = part.subarray(piece.length); else this.parts.shift();
    }
    this.length -= count;
    return taken;
  }
}
