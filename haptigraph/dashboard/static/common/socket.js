/** The WebSocket to the server: messages in both directions, and reconnection. */

const RETRY_MS = [250, 500, 1000, 2000];

/** Keep a socket open.
 *  @param {{onText: (type: keyof ServerMessages, message: any) => void, onOpen: () => void, onLost: () => void,
 *           onImage: FeedHandlers["image"]}} handlers `onLost` is called as soon as the connection breaks
 *  @param {string} path of the socket
 *  @returns {{send: Send}} messages are dropped while there is no connection */
export function connect(handlers, path) {
  /** @type {WebSocket} */ let socket;
  let failures = 0;

  function open() {
    socket = new WebSocket(`ws://${location.host}${path}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { failures = 0; handlers.onOpen(); };
    socket.onmessage = (event) => receive(event.data);
    socket.onclose = () => {
      handlers.onLost();
      setTimeout(open, RETRY_MS[Math.min(failures++, RETRY_MS.length - 1)]);
    };
  }

  function receive(/** @type {string | ArrayBuffer} */ data) {
    if (typeof data === "string") { const message = JSON.parse(data); handlers.onText(message.type, message); return; }
    const { header, picture } = unpack(data);
    send({ type: "ack", number: header.number });
    handlers.onImage(header, picture);
  }

  function send(/** @type {ClientMessage} */ message) {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  }

  open();
  return { send };
}

/** Decode an image message: length of the JSON (4 bytes, big-endian), JSON, JPEG. @param {ArrayBuffer} data */
export function unpack(data) {
  const length = new DataView(data).getUint32(0);
  const header = /** @type {ImageHeader} */ (JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))));
  return { header, picture: header.has_picture ? new Uint8Array(data, 4 + length) : null };
}
