/** Types that modules of the pages share, beside the messages. */

/** What makes a view unreliable; `isCut`: the page itself receives nothing; `isSmall`: the picture remains useful. */
interface Problem { title: string, detail: string, isCut: boolean, isSmall?: boolean }
type Overlay = "needle" | "uncertainty" | "cone" | "zone" | "target" | "port";
/** A JPEG, or an image that is decoded already. */
type Picture = Uint8Array<ArrayBuffer> | ImageBitmap | null;
/** A node of the scene graph on the page. */
interface NodePosition { x: number, y: number, isLeft: boolean }
interface Box { left: number, width: number, top: number, height: number }
/** An edge of the drawn scene graph; `curve` turns a share of its way into a point. */
interface Edge { group: SVGGElement, text: SVGTextElement, curve: (share: number) => { x: number, y: number } }
/** The bounds that decide by a measure, and up to where its values are tolerated. */
interface Bounds { bounds: number[], band: number }
/** A curve over time: a measure, the bounds that decide by it, and its scale. */
interface Strip extends Bounds { measure: string, label: string, unit: string, digits: number, min: number, max: number }
/** A strip on the timeline; `compared`: the bounds of the procedure that the run is compared with, where they differ. */
interface StripBox { strip: Strip, compared: Bounds | null, top: number, height: number }
/** The values of a curve within one column of pixels. */
interface PixelColumn { x: number, isStart: boolean, first: number, min: number, max: number, last: number }
type RecordedRun = import("../recordings/run.js").Run<RecordedContent>;
type ComparedRun = import("../recordings/run.js").Run<ComparisonContent>;
/** A step to jump to, with the icon of a state or a mark. */
interface RunEvent { number: number, kind: "state" | "fault" | "difference", text: string, state?: StateDescription, mark?: string }

/** What a controller can do: by moving an axis, or pressing a button. */
type Action = "along" | "across" | "clutch" | "fine" | "filter" | "open" | "close" | "outwards";
interface ActionInfo { label: string, kind: "axis" | "button", needsJaws?: boolean, needsRobot?: boolean }
/** An axis with a sign, or a button. */
interface ControllerInput { index: number, sign?: number }
type Mapping = Record<Action, ControllerInput>;
interface PadValues { axes: number[], buttons: number[] }
type KeyMap = Record<string, [axis: "along" | "across" | "apart" | "outwards" | "clutch", value: number]>;

interface TrocarRow { item: HTMLLIElement, radio: HTMLInputElement, text: HTMLInputElement, remove: HTMLButtonElement }
/** A questionnaire of a participant. */
interface Place { participant: string, key: string }
