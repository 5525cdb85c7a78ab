/** The line to the server: texts and images in, texts out, and again when it breaks. Knows no drawing. */

const RETRY_MS = [250, 500, 1000, 2000];

/**
 * Keep a socket open.
 *
 * @param {{onText: (message: any) => void,
 *          onImage: (header: any, picture: Uint8Array | null) => void,
 *          onOpen: () => void,
 *          onLost: () => void}} hear what to call; `onLost` the moment the line breaks
 */
export function connect(hear) {
  let socket = null;
  let failures = 0;

  function open() {
    socket = new WebSocket(`ws://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { failures = 0; hear.onOpen(); };
    socket.onmessage = (event) => receive(event.data);
    socket.onclose = () => {
      hear.onLost();
      setTimeout(open, RETRY_MS[Math.min(failures++, RETRY_MS.length - 1)]);
    };
  }

  function receive(data) {
    if (typeof data === "string") { hear.onText(JSON.parse(data)); return; }
    const { header, picture } = unpacked(data);
    send({ type: "ack", number: header.number });
    hear.onImage(header, picture);
  }

  function send(message) {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  }

  open();
  return { send, close: () => { socket.onclose = null; socket.close(); } };
}

/** Take an image message apart: length of the JSON (4 bytes, big-endian), JSON, JPEG. */
export function unpacked(data) {
  const length = new DataView(data).getUint32(0);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  return { header, picture: header.has_picture ? new Uint8Array(data, 4 + length) : null };
}
