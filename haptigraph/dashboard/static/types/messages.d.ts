/** The JSON that server and pages exchange. Keys of Python structs are theirs: Step, Procedure, Draft, Timeline. */

type Vec = [number, number];
type Names = [subject: string, predicate: string, object: string];
type PointShape = { type: "point", at_mm: Vec };
type Shape = PointShape | { type: "segment", start_mm: Vec, end_mm: Vec } | { type: "polyline", points_mm: Vec[] }
  | { type: "circle", center_mm: Vec, radius_mm: number } | { type: "phase" };

// --- /live: server/protocol.py, server/describe.py

interface Entity { name: string, group: string, geometry: string, visible_with: string, only_with: string }
interface Relation {
  subject: string, predicate: string, object: string, measure: string, measure_name: string,
  at_most: number | null, below: number | null, at_least: number | null, above: number | null,
}
interface Pattern { name: string, kind: "off" | "continuous" | "pulses" | "bursts", amplitude: number, count: number, on_ms: number, off_ms: number }
interface StateDescription {
  name: string, label: string, feel: string, priority: number, column: "left" | "middle" | "right",
  icon: "alarm" | "done" | "warn" | "calm" | "idle" | "lost" | "tipless" | "unseen", color: string, ink: string,
}
interface Procedure {
  name: string, title: string, sha256: string, entities: Entity[], relations: Relation[],
  states: StateDescription[], patterns: Pattern[],
}
interface Hello {
  procedure: Procedure, anatomy: Record<string, Shape>, view: { size_px: number, half_mm: number, center_mm: Vec, across_mm: number | null, above_mm: number | null }, source: string,
  device: string, recording: string, stale_ms: number, deadman_ms: number, assumed: string[], silenced: boolean, steerable?: boolean, has_jaws?: boolean, robot?: string,
}
interface ImageHeader {
  number: number, index: number, time_ms: number, commanded_ms: number, state: string, because: string, feel: string,
  plays: string, forces: string[], evidence: Names[], nodes: string[], edges: Names[], measures: Record<string, number>,
  found: Record<string, Shape>, beside: Record<string, Shape>[], sd_mm: Record<string, number>, faults: string[], in_space: string, has_picture: boolean, hand: { engaged: boolean } | null,
}
type HapticEdge = [time_ms: number, amplitude: number, frequency_hz: number];
interface BrokenClaim { claim: string, times: number, worst: number, unit: string }
interface Health {
  now_ms: number, rate_hz: number, nominal_hz: number, latency_p50_ms: number | null, latency_p99_ms: number | null,
  overruns: number, skipped: number, dropped: number, faults: Record<string, [time_ms: number, message: string]>,
  broken: BrokenClaim[], viewers: string[],
}
interface TeleopSettings { motion_scale: number, tremor_filter: boolean, added_tremor_mm: number }
interface RobotStatus {
  uri: string, is_moving: boolean, is_switched_on: boolean, reasons: string[], state: string, is_homed: boolean,
  tip_mm: [number, number, number] | null, rate_hz: number, late: number, error: string,
}
interface ServerMessages {
  welcome: { name: string, may_steer: boolean, refusal: string }, robot: RobotStatus, hello: Hello, controls: { holder: string }, settings: TeleopSettings,
  haptics: { edges: HapticEdge[] }, alive: { time_ms: number }, health: Health, pong: { time_ms: number, now_ms: number },
  error: { message: string }, ended: { reason: string }, score: { text: string }, study: { version: number },
}
interface HandMotion { engaged: boolean, along_mm: number, across_mm: number, apart_mm: number, outwards_mm: number }
type ClientMessage = { type: "ack", number: number } | { type: "watch", images: boolean } | { type: "ping", time_ms: number }
  | { type: "take_controls" } | { type: "release_controls" } | { type: "motion", hand: HandMotion, sent_ms: number | null }
  | { type: "switch_robot", on: boolean }
  | ({ type: "tune" } & Partial<TeleopSettings>) | { type: "enter_phase", phase: string }
  | { type: "outputs", names: string[] } | { type: "played", output: string, start_ms: number, end_ms: number };
type Send = (message: ClientMessage) => void;
/** What a page does with each message, and with events of its connection. */
type FeedHandlers = { [K in keyof ServerMessages]?: (message: ServerMessages[K]) => void } & {
  image: (header: ImageHeader, picture: Uint8Array<ArrayBuffer> | null) => void,
  opened?: () => void, lost?: () => void, hidden?: () => void,
};
interface HapticLevel { amplitude: number, frequency_hz: number }
/** A way to play haptic feedback on a page; a level of 0 is silence at once. */
interface HapticOutput { play(level: HapticLevel, until_ms: number, now_ms: number): void }
// --- /recordings: recordings/folder.py, jobs/*.py, server/stream.py

interface Measures {
  ends_in: string, started_ms: number | null, ended_ms: number | null, completion_s: number | null,
  mean_theta_deg: number | null, contacts: number, changes: number, claims: { name: string, cases: number, broken: number }[],
  steps: number, tipless_steps: number, longest_tipless_s: number,
  state_s: Record<string, number>, all_state_s: Record<string, number>, length_s: number,
}
type Outcome = Measures & { name: string, problem?: string };
interface RunRow {
  name: string, size: number, started_utc: string, length_s: number | null, source: string, procedure: string,
  participant: string, trial: string, is_whole: boolean, is_being_written: boolean, problem: string,
  outcome: Outcome | null,
}
interface FoundRow {
  recording: string, started_utc: string | null, procedure: string | null, participant: string | null,
  outcome: string | null, problem: string, first_step: number | null,
}
interface Found { rows: FoundRow[], is_complete: boolean, note: string }
interface RunListing { folder: string, runs: RunRow[], left_out: number, procedures: string[] }
interface FaultSpan { first: number, last: number, where: string, message: string, ended: string }
type ColumnType = "f8" | "f4" | "u2";
/** Fields of a timeline and of a comparison; both describe the columns that follow. */
interface RunContent {
  columns: [name: string, type: ColumnType, length: number][], states: string[], patterns: string[],
  faults: FaultSpan[], measures: Measures,
}
interface RecordedContent extends RunContent {
  hello: Hello, image_from_eye_px: [Vec, Vec, Vec], notes: string[], has_truth: boolean,
  run: { started_utc: string, participant: string, trial: string, version: string },
}
interface ComparisonContent extends RunContent {
  state_descriptions: StateDescription[], relations: Relation[], procedure: string, steps: number, identical: number,
  state_differs: number, haptics_differ: number, dropped_images: number, differing_images: number,
}
type Columns = Record<string, Float64Array | Float32Array | Uint16Array>;
/** Steps in which two runs differ, end excluded; either in their state, or in their haptic pattern only. */
type Difference = [first: number, end: number, isState: boolean];

// --- /registration: registration/page.py, analysis/registering/

interface DraftTrocar { name: string, point_px: Vec, used: boolean }
interface Draft {
  mirrored: boolean, diameter_mm: number, center_px: Vec, radius_px: number, contour_px: Vec[], target_px: Vec,
  trocars: DraftTrocar[], frontal_from_image: number[][] | null, assumed: string[], file: string,
}
interface OpenedSource {
  number: number, width_px: number, height_px: number, draft: Draft, is_found: boolean, note: string, path: string,
}
interface DraftRow {
  what: string, where: string, off_px: number | null, off_mm: number | null, note: string, is_plausible: boolean,
}
interface CheckedDraft {
  problem: string, mm_per_px: number, rows: DraftRow[], outline_px: Vec[], target_on_retina_px: Vec | null,
}
/** Answers of the routes, by name. */
interface RegistrationRoutes {
  start: { source: string, starts_loop: boolean }, progress: { progress: string }, open: OpenedSource | { cancelled: true }, cancel: object,
  check: CheckedDraft, load: { draft: Draft }, save: { paths: string[], exists: string },
}
/** A draggable point of a draft. */
interface Handle {
  key: string, kind: "center" | "radius" | "retina" | "trocar" | "target", index: number, title: string,
  label?: string, at: Vec,
}
