import { connect } from "./socket.js";
const state = document.getElementById("state");
connect({
  onText: () => {}, onOpen: () => {}, onLost: () => { state.textContent = "lost"; },
  onImage: (header) => { state.textContent = header.state; document.body.dataset.index = header.index; },
});
