/** The live page: hands every message to those who show it. */

import { every } from "../server/animate.js";
import { Controller } from "./gamepad.js";
import { Controls } from "./controls.js";
import { Diagram } from "./states.js";
import { Feed } from "../server/feed.js";
import { Graph } from "../server/graph.js";
import { Phases } from "./phases.js";
import { Rumble } from "./rumble.js";
import { toggle } from "../server/signs.js";
import { Steering } from "./steering.js";
import { Frame, Tone } from "./standin.js";
import { Banner, Status } from "../server/status.js";
import { Touch } from "../server/touch.js";
import { Traces } from "../server/traces.js";
import { View } from "../server/view.js";

const DRAW_MS = 1000 / 20;
const $ = (id) => document.getElementById(id);

const view = new View($("view"), $("overlays"));
const diagram = new Diagram($("diagram"));
const graph = new Graph($("graph"));
const status = new Status();
const banner = new Banner();
const touch = new Touch(150);
const controller = new Controller();
const rumble = new Rumble(() => controller.pad());

/** What this page knows. */
export const page = new Feed(touch, {
  hello(message) {
    for (const part of [status, view, controls, phases]) part.begin(message);
    for (const part of [diagram, graph, traces]) part.begin(message.procedure);
  },
  touch({ edges }) { traces.touch(edges); },
  health(message) { if (page.hello) status.health(message, page.latency_ms); },
  controls({ holder }) { controls.showHolder(holder); phases.allow(holder === "" || holder === controls.me); },
  settings(message) { controls.showSettings(message); },
  you({ name }) { controls.me = name; },
  image(header, picture) {
    status.show(header);
    diagram.show(header.state);
    graph.show(header);
    phases.show(header);
    traces.add(header);
    view.show(header, picture);
  },
  lost() { controls.showHolder(""); },
  hidden() { steering.letGo(); page.send({ type: "release" }); },
});
const traces = new Traces($("traces"), page.clock);
const steering = new Steering(page.send, controller, $("view"));
const controls = new Controls(page.send, steering, controller);
const phases = new Phases($("phases"), page.send);

view.onDrawn = (header) => page.wasDrawn(header);

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

const calm = matchMedia("(prefers-reduced-motion: reduce)");
every(() => (calm.matches ? 500 : DRAW_MS), () => {
  const what = page.lost();
  banner.update(what);
  $("view").classList.toggle("lost", Boolean(what?.[2]) || page.header?.has_picture === false);
  traces.draw();
  controls.show();
});
