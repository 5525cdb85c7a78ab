/** The last 20 seconds: distance, angle, touch, and a ribbon of states. On the server's clock. */

const SPAN_MS = 20_000, LEFT = 92, RIGHT = 12, RIBBON = 12;
const INK = "#e8edf1", QUIET = "#9aabb8", FAINT = "#2c3740";

export class Traces {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {import("./clock.js").ServerClock} clock
   */
  constructor(canvas, clock) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.clock = clock;
    this.strips = [];
    this.clear();
    new ResizeObserver(() => this.fit()).observe(canvas);
  }

  begin(procedure) {
    this.colors = Object.fromEntries(procedure.states.map((state) => [state.name, state.color]));
    this.strips = stripsOf(procedure.relations);
    this.clear();
  }

  clear() { this.steps = []; this.edges = []; }

  add(header) {
    const last = this.steps.at(-1);
    if (last && header.time_ms < last.time_ms) this.clear();
    this.steps.push({ time_ms: header.time_ms, state: header.state, measures: header.measures });
    const oldest = header.time_ms - SPAN_MS - 500;
    while (this.steps[0].time_ms < oldest) this.steps.shift();
    while (this.edges.length > 1 && this.edges[1][0] < oldest) this.edges.shift();
  }

  /** Take what the device was told: [time_ms, amplitude, frequency_hz] each. */
  touch(edges) { this.edges.push(...edges); }

  fit() {
    const ratio = devicePixelRatio || 1;
    this.width = this.canvas.clientWidth; this.height = this.canvas.clientHeight;
    this.canvas.width = Math.round(this.width * ratio); this.canvas.height = Math.round(this.height * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.draw();
  }

  draw() {
    const { context: c, width, height } = this;
    if (!width) return;
    c.fillStyle = "#161d23";
    c.fillRect(0, 0, width, height);
    const now_ms = this.clock.now_ms();
    if (!this.strips.length || !(now_ms >= 0)) return;
    this.x = (time_ms) => LEFT + (1 - (now_ms - time_ms) / SPAN_MS) * (width - LEFT - RIGHT);
    const room = height - RIBBON - 18, each = room / (this.strips.length + 1);
    c.font = "12px " + getComputedStyle(document.body).fontFamily;
    this.strips.forEach((strip, at) => this.drawStrip(strip, at * each + 3, each - 9));
    this.drawTouch(this.strips.length * each + 3, each - 9);
    this.drawRibbon(room + 2);
    this.drawTime(height - 3);
  }

  drawStrip(strip, top, height) {
    const c = this.context;
    const y = (value) => top + height * (1 - Math.min(Math.max((value - strip.least) / (strip.most - strip.least), 0), 1));
    c.fillStyle = "#5cc48422";
    if (strip.band) c.fillRect(LEFT, y(strip.band), this.width - LEFT - RIGHT, y(0) - y(strip.band));
    c.strokeStyle = FAINT; c.lineWidth = 1;
    for (const bound of strip.bounds) { c.beginPath(); c.moveTo(LEFT, y(bound)); c.lineTo(this.width - RIGHT, y(bound)); c.stroke(); }
    const last = this.steps.at(-1)?.measures[strip.measure];
    this.label(strip.words, top + 11, !Number.isFinite(last) ? "–" : `${last.toFixed(strip.digits)} ${strip.unit}`);
    c.strokeStyle = INK; c.lineWidth = 1.8; c.lineJoin = "round"; c.beginPath();
    let before = null;
    for (const step of this.steps) {
      const value = step.measures[strip.measure];
      if (Number.isFinite(value)) {
        const joins = before && step.time_ms - before < 300;
        c[joins ? "lineTo" : "moveTo"](Math.max(this.x(step.time_ms), LEFT), y(value));
        before = step.time_ms;
      } else before = null;
    }
    c.stroke();
    c.fillStyle = QUIET; c.textAlign = "left";
    for (const [at, bound] of strip.bounds.entries())
      if (!strip.bounds.slice(0, at).some((other) => Math.abs(y(other) - y(bound)) < 11)) c.fillText(String(bound), LEFT + 4, y(bound) - 2);
  }

  drawTouch(top, height) {
    const c = this.context;
    this.label("touch", top + 11, this.edges.length && this.edges.at(-1)[1] ? `${Math.round(this.edges.at(-1)[1] * 100)} %` : "silent");
    c.strokeStyle = FAINT; c.beginPath(); c.moveTo(LEFT, top + height); c.lineTo(this.width - RIGHT, top + height); c.stroke();
    c.fillStyle = "#f0a546";
    this.edges.forEach(([time_ms, amplitude], at) => {
      if (!amplitude) return;
      const end = this.edges[at + 1] ? this.x(this.edges[at + 1][0]) : this.width - RIGHT;
      const start = Math.max(this.x(time_ms), LEFT);
      if (end > LEFT) c.fillRect(start, top + height * (1 - amplitude), Math.max(end - start, 1), height * amplitude);
    });
  }

  drawRibbon(top) {
    const c = this.context;
    this.steps.forEach((step, at) => {
      const start = Math.max(this.x(step.time_ms), LEFT), next = this.steps[at + 1];
      const end = next ? this.x(next.time_ms) : Math.min(this.x(step.time_ms + 40), this.width - RIGHT);
      if (end <= LEFT) return;
      c.fillStyle = this.colors[step.state] ?? QUIET;
      c.fillRect(start, top, end - start + 0.5, RIBBON - 3);
    });
    this.label("state", top + 9, "");
  }

  drawTime(bottom) {
    const c = this.context;
    c.fillStyle = QUIET; c.textAlign = "center";
    for (let ago = 0; ago <= 20; ago += 5) c.fillText(ago ? `${ago} s` : "now", Math.min(this.x(this.clock.now_ms() - ago * 1000), this.width - RIGHT - 8), bottom);
  }

  label(words, y, value) {
    const c = this.context;
    c.textAlign = "left"; c.fillStyle = QUIET; c.fillText(words, 2, y);
    c.fillStyle = INK; c.save(); c.font = c.font.replace("12px", "bold 15px"); c.fillText(value, 2, y + 18); c.restore();
  }
}

/** Choose what to plot: two depths in um, or the first distance and angle a procedure decides by, or else its first measures. */
export function stripsOf(relations) {
  const measures = [...new Set(relations.map((relation) => relation.measure_name))];
  const depths = measures.filter((name) => name.endsWith("_um")).slice(0, 2);
  const wanted = depths.length ? depths : ["mm", "deg"].map((unit) => measures.find((name) => name.endsWith(`_${unit}`))).filter(Boolean);
  return (wanted.length ? wanted : measures.slice(0, 2)).map((measure) => strip(measure, relations));
}

function strip(measure, relations) {
  const own = relations.filter((relation) => relation.measure_name === measure);
  const bounds = [...new Set(own.flatMap((r) => [r.at_most, r.below, r.at_least, r.above]).filter((b) => b !== null && b !== undefined))];
  const unit = measure.split("_").at(-1), largest = Math.max(...bounds, 1e-6);
  const isAngle = unit === "deg", isDepth = unit === "um";
  return {
    measure, bounds, unit: isAngle ? "°" : isDepth ? "µm" : unit, digits: isDepth ? 0 : isAngle ? 1 : 2,
    words: measure.replace(/_(mm|um|deg)$/, "").replace("distance_to_", "to ").replaceAll("_", " "),
    least: isAngle ? 0 : isDepth ? -0.5 * largest : -1, most: largest * (isAngle || (isDepth && bounds.length === 1) ? 5 : 2),
    band: isAngle ? Math.min(...own.map((r) => r.at_most ?? Infinity)) : 0,
  };
}
