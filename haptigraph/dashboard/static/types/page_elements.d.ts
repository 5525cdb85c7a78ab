/** The elements that scripts find by id, by their type; `tests/dashboard/server/test_static.py` compares them with the HTML. */

type PageElements =
  & Record<"about" | "amplitude" | "answered" | "axes" | "banner" | "because" | "buttons" | "calibration" | "calibration-count" | "calibration-result" | "calibration-status" |
    "calibration-text" | "calibration-title" | "clock" | "clutch" |
    "consequence" | "depth" | "detail" | "doing" | "found-count" | "empty" | "events" | "exists-title" | "fault" | "feels" | "folder" |
    "hand" | "health" | "help" | "holder" | "idle" | "in-space" | "instead" | "items" | "jaws" | "keys" | "lanes" | "list" | "monitor"
    | "name" | "no-picture" | "note" | "notes" | "now" | "pad" | "participant" | "picture-panel" | "places" |
    "plan" | "problem" | "procedure" | "question" | "questionnaire-intro" | "questionnaire-source" |
    "questionnaire-title" | "ready" | "robot" | "robot-facts" | "robot-name" | "robot-reasons" | "robot-state" | "roster" | "run" | "scale-value" | "score" | "simulated" | "source" | "stage" |
    "state" | "station" | "steering" | "steps" | "switches" | "text" | "text-body" | "text-title" | "title" |
    "tools" | "touch-check" | "touch-text" | "trial" | "trial-condition" | "trial-status" | "trial-text" | "trial-title" | "trocars" |
    "verdict" | "wait" | "wait-title" | "waiting" | "way" | "who" | "work", HTMLElement>
  & Record<"abort" | "add" | "begin" | "cancel" | "closer" | "enrol-button" | "felt" | "compare" | "confirm" | "csv" | "deadman" | "find" | "robot-switch" | "finish" |
    "hold" | "leave" | "load" | "map" | "note-save" | "play" | "pulse" | "png" | "redo" | "refresh" | "repeat" | "restore"
    | "save-button" | "skip" | "standard" | "stop" | "text-done" | "try" | "undo" | "unenrol" | "unfelt" | "whole" | "wider" | "withdraw",
    HTMLButtonElement>
  & Record<"loupe" | "timeline" | "traces" | "view", HTMLCanvasElement>
  & Record<"ask" | "exists" | "mapping", HTMLDialogElement>
  & Record<"anatomy" | "choices" | "learn" | "outputs" | "overlays" | "phases", HTMLFieldSetElement>
  & Record<"enrol" | "find-form" | "note-form" | "open" | "questionnaire" | "save", HTMLFormElement>
  & Record<"image", HTMLImageElement>
  & Record<"diameter" | "filter" | "mirrored" | "path" | "picture" | "pseudonym" | "scale" | "source-input" |
    "together" | "tremor", HTMLInputElement>
  & Record<"done" | "progress", HTMLProgressElement>
  & Record<"other" | "which", HTMLSelectElement>
  & Record<"actions" | "found" | "measures" | "measures-head" | "rows" | "runs", HTMLTableSectionElement>
  & Record<"note-text" | "reason", HTMLTextAreaElement>
  & Record<"diagram" | "graph" | "icon" | "overlay", SVGSVGElement>;
