/** The JSON of a study's pages: study/snapshots.py. */

type TrialStatus = "" | "preparing" | "running" | "ending";
interface StageSummary {
  key: string, kind: "briefing" | "consent" | "questionnaire" | "training" | "trial" | "break" | "thanks",
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
type ParticipantStage = TextStage | QuestionnaireStage | TrialStage;
interface StudyStatus { version: number, title: string, simulated: boolean, trial_status: TrialStatus, has_problem: boolean }
/** The fields from `done` on are there if a participant is. */
interface ParticipantStatus extends StudyStatus {
  participant: string, done: number, total: number, ended: string, thanks: string, stage?: ParticipantStage,
}
interface PlannedStage {
  key: string, title: string, condition: string, is_done: boolean,
  attempts: { attempt: number, outcome: "hit" | "timeout" | "aborted" | null, void: string | null }[],
}
interface CurrentSession {
  participant: string, done: number, total: number, ended: string, stage: StageSummary | null, repeatable: string,
  has_haptics: boolean, plan: PlannedStage[], events: { kind: string, text: string, at_utc: string }[],
}
interface ParticipantRow {
  participant: string, order: string[], done: number, total: number, next: string, ended: boolean,
  has_left: boolean, running: boolean, station: string, void: number,
}
interface ExperimenterStatus extends StudyStatus {
  name: string, station: string, max_participants: number, shows_conditions: boolean, problem: string, remark: string,
  elapsed_s: number | null, current: CurrentSession | null, participants: ParticipantRow[],
}
