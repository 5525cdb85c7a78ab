/** The JSON of a study's pages: study/snapshots.py. */

type TrialStatus = "" | "preparing" | "running" | "ending" | "stimulus";
interface StageSummary {
  key: string, kind: "briefing" | "consent" | "questionnaire" | "calibration" | "training" | "trial" | "break" | "thanks",
  title: string, condition: string, attempt: number, running: boolean, timeout_s: number, free: boolean,
  answer_count: number, item_count: number,
}
interface QuestionnaireItem {
  key: string, text: string, kind: "scale" | "choice" | "number" | "text", required: boolean, choices: string[],
  low: number | null, high: number | null, low_label: string, high_label: string, unit: string, valid: string,
}
type QuestionnaireStage = StageSummary & {
  intro: string, source: string, items: QuestionnaireItem[], answers: Record<string, string>,
};
type TextStage = StageSummary & { text: string };
type TrialStage = StageSummary & { display: "ioct" | "overlays" };
type CalibrationStage = StageSummary & {
  number: number, of: number, round: number, choices: string[], may_learn: boolean, played: boolean,
};
type ParticipantStage = TextStage | QuestionnaireStage | CalibrationStage | TrialStage;
interface StudyStatus { version: number, title: string, simulated: boolean, trial_status: TrialStatus, has_problem: boolean }
/** The outputs of haptic feedback, joined by " + "; and why a trial must not begin with them. */
interface TouchStatus { output: string, problem: string }
/** The fields from `done` on are there if a participant is. */
interface ParticipantStatus extends StudyStatus {
  touch?: TouchStatus, participant: string, done: number, total: number, ended: string, thanks: string, stage?: ParticipantStage,
}
interface PlannedStage {
  key: string, title: string, condition: string, is_done: boolean,
  attempts: { attempt: number, outcome: "hit" | "timeout" | "aborted" | null, void: string | null }[],
}
interface CurrentSession {
  participant: string, done: number, total: number, ended: string, stage: StageSummary | null, repeatable: string,
  touch: TouchStatus, may_undo_enrolment: boolean, has_haptics: boolean, calibration: string, plan: PlannedStage[],
  events: { kind: string, text: string, at_utc: string }[],
}
interface ParticipantRow {
  participant: string, order: string[], done: number, total: number, next: string, ended: boolean,
  has_left: boolean, has_consented: boolean, running: boolean, station: string, void: number,
}
interface ExperimenterStatus extends StudyStatus {
  name: string, station: string, max_participants: number, shows_conditions: boolean, problem: string, remark: string,
  elapsed_s: number | null, current: CurrentSession | null, participants: ParticipantRow[],
}
