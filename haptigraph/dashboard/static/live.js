/** The live page: hands every message to those who show it. */

import { ServerClock } from "./clock.js";
import { Controller } from "./gamepad.js";
import { Controls } from "./controls.js";
import { Diagram } from "./states.js";
import { Graph } from "./graph.js";
import { Rumble } from "./rumble.js";
import { toggle } from "./signs.js";
import { connect } from "./socket.js";
import { Steering } from "./steering.js";
import { Frame, Tone } from "./standin.js";
import { Banner, Status, lostIn } from "./status.js";
import { Touch } from "./touch.js";
import { Traces } from "./traces.js";
import { View } from "./view.js";

const PING_MS = 2000, DRAW_MS = 1000 / 20;
const $ = (id) => document.getElementById(id);

const clock = new ServerClock();
const view = new View($("view"), $("overlays"));
const diagram = new Diagram($("diagram"));
const graph = new Graph($("graph"));
const traces = new Traces($("traces"), clock);
const status = new Status();
const banner = new Banner();
const touch = new Touch(150);
const controller = new Controller();
const rumble = new Rumble(() => controller.pad());
/** What this page knows. Tests and benchmarks read it, and may listen: `onImage`, `onDrawn`. */
export const page = {
  clock, hello: null, header: null, drawn: 0, onImage: () => {}, onDrawn: () => {},
  heard_ms: -Infinity, latency_ms: NaN, ended: "", isOpen: false,
};

const hear = {
  hello(message) {
    page.hello = message;
    page.header = null;
    page.ended = "";
    touch.stale_ms = message.deadman_ms;
    for (const part of [status, view, controls]) part.begin(message);
    for (const part of [diagram, graph, traces]) part.begin(message.procedure);
  },
  touch({ edges }) { traces.touch(edges); touch.told(edges); },
  health(message) { if (page.hello) status.health(message, page.latency_ms); },
  pong({ time_ms, now_ms }) { clock.heard(time_ms, now_ms); },
  ended({ reason }) { page.ended = reason; touch.silence(); },
  error({ message }) { console.warn(message); },
  controls({ holder }) { controls.showHolder(holder); },
  settings(message) { controls.showSettings(message); },
  you({ name }) { controls.me = name; },
};

const line = connect({
  onText: (message) => hear[message.type]?.(message),
  onImage(header, picture) {
    page.header = header;
    page.heard_ms = performance.now();
    status.show(header);
    diagram.show(header.state);
    graph.show(header);
    traces.add(header);
    touch.fresh();
    page.onImage(header);
    view.show(header, picture);
  },
  onOpen() { page.isOpen = true; clock.reset(); ping(); watch(); },
  onLost() { page.isOpen = false; touch.silence(); controls.showHolder(""); },
});
const steering = new Steering(line.send, controller, $("view"));
const controls = new Controls(line.send, steering, controller);

view.onDrawn = (header) => {
  page.drawn += 1;
  page.onDrawn(header);
  const age_ms = clock.now_ms() - header.time_ms;
  page.latency_ms = Number.isNaN(page.latency_ms) ? age_ms : page.latency_ms + 0.1 * (age_ms - page.latency_ms);
};

touch.add(rumble);
touch.add({ play: (level) => status.amplitude(level.amplitude) });
const frame = new Frame(), tone = new Tone();
touch.add(frame);
touch.add(tone);
$("outputs").append(
  toggle("controller", true, (on) => rumble.enable(on), "touch-controller"),
  toggle("screen", false, (on) => frame.enable(on), "touch-screen"),
  toggle("sound", false, (on) => tone.enable(on)),
);

function ping() { line.send({ type: "ping", time_ms: performance.now() }); }
function watch() { line.send({ type: "watch", images: !document.hidden }); }
setInterval(ping, PING_MS);
for (const wait_ms of [50, 100, 200, 400]) setTimeout(ping, wait_ms);

document.addEventListener("visibilitychange", () => {
  if (document.hidden) {
    touch.silence();
    steering.letGo();
    line.send({ type: "release" });
  }
  page.heard_ms = performance.now();
  watch();
});
addEventListener("pagehide", () => { touch.silence(); steering.letGo(); });

/** Say what cannot be trusted now; null if all is well. */
function lost() {
  if (!page.isOpen) return ["Connection lost", "The server does not answer. What you see is old.", true];
  if (page.ended) return ["The run has ended", page.ended, true];
  const silent_ms = performance.now() - page.heard_ms;
  if (page.header && silent_ms > 200 + 2 * page.hello.stale_ms) return ["No news", `Nothing from the loop for ${(silent_ms / 1000).toFixed(1)} s.`, true];
  return page.header && lostIn(page.header, page.hello);
}

let drawn_ms = 0;
const calm = matchMedia("(prefers-reduced-motion: reduce)");
function animate(now_ms) {
  requestAnimationFrame(animate);
  if (now_ms - drawn_ms < (calm.matches ? 500 : DRAW_MS) - 4) return;
  drawn_ms = now_ms;
  const what = lost();
  banner.update(what);
  $("view").classList.toggle("lost", Boolean(what?.[2]) || page.header?.has_picture === false);
  traces.draw();
  controls.show();
}
requestAnimationFrame(animate);
