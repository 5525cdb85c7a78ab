/** The live page: passes every message to the parts that show it. */

import { Assumed } from "./assumed.js";
import { animate } from "../common/animate.js";
import { Controller } from "./gamepad.js";
import { Controls } from "./controls.js";
import { Diagram } from "./diagram.js";
import { $, showOrHide } from "../common/dom.js";
import { Feed } from "../common/feed.js";
import { Graph } from "../common/graph.js";
import { showHint } from "../common/hint.js";
import { Haptics } from "../common/haptics.js";
import { InSpace } from "./in_space.js";
import { addOutputs } from "./outputs.js";
import { Phases } from "./phases.js";
import { Banner, StatePanel } from "../common/state_panel.js";
import { Robot } from "./robot.js";
import { Steering } from "./steering.js";
import { Traces } from "../common/traces.js";
import { View } from "../common/view.js";

const DRAW_MS = 1000 / 20;
const HINTS = {
  steer: "Hold ↓ to push the needle into the eye, ↑ to pull it back, ← and → to turn it, or drag in the picture. The panel beside the picture says what the hand feels, and why. A game controller plays it; without one, switch on screen or sound there.",
  robot: "The page moves a robot. Switch on “Enable motion”, then hold “Hold to move” or Space, and press ↓ ↑ ← →. Let go, and it is held at once. The panel says why it is held.",
  watch: "The picture shows what was found in the image; the panel beside it names the state, and the reason. “The hand feels” is what was sent to the haptic device. To feel it here, connect a game controller, or switch on screen or sound.",
};

const view = new View($("view"), $("overlays"));
const diagram = new Diagram($("diagram"));
const graph = new Graph($("graph"));
const panel = new StatePanel();
const banner = new Banner();
const haptics = new Haptics(150);
const controller = new Controller();
const inSpace = new InSpace();
const assumed = new Assumed($("view"));

/** The page's state. */
export const page = new Feed(haptics, {
  hello(hello) {
    for (const part of [panel, view, controls, phases, assumed, robot, inSpace]) part.begin(hello);
    for (const part of [diagram, graph, traces]) part.begin(hello.procedure);
    const kind = hello.robot ? "robot" : hello.steerable ? "steer" : "watch";
    showHint(kind, HINTS[kind]);
  },
  haptics({ edges }) { traces.addEdges(edges); },
  health(health) { if (page.hello) panel.showHealth(health, page.latency_ms); },
  controls({ holder }) { controls.showHolder(holder); phases.allow(controls.maySteer && (holder === "" || holder === controls.me)); },
  score({ text }) { showOrHide($("score"), text); },
  settings(settings) { controls.showSettings(settings); },
  robot(status) { robot.update(status); },
  welcome({ name, may_steer, refusal }) { controls.me = name; controls.maySteer = may_steer; robot.refusal = refusal; },
  image(header, picture) {
    for (const part of [panel, graph, phases, inSpace]) part.show(header);
    diagram.show(header.state);
    traces.add(header);
    view.show(header, picture);
  },
  lost() { controls.showHolder(""); },
  hidden() { steering.release(); page.send({ type: "release_controls" }); },
});
const traces = new Traces($("traces"), page.clock);
const steering = new Steering(page.send, controller, $("view"), page.clock);
const controls = new Controls(page.send, steering, controller);
const robot = new Robot(page.send, steering);
const phases = new Phases($("phases"), page.send);

view.onDrawn = (header) => page.noteDrawn(header);
addOutputs(haptics, controller, $("outputs"));
haptics.add({ play: ({ amplitude }) => panel.showAmplitude(amplitude) });

const prefersCalm = matchMedia("(prefers-reduced-motion: reduce)");
animate(() => (prefersCalm.matches ? 500 : DRAW_MS), () => {
  const problem = page.problem();
  banner.update(problem);
  $("view").classList.toggle("lost", problem?.isCut || page.header?.has_picture === false);
  traces.draw();
  controls.show();
  robot.show();
});
