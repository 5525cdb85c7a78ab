/** Touch where there is no actuator: a frame about the page, and a tone. */

/** A frame about the page, as strong as the touch. */
export class Frame {
  constructor() { this.isOn = false; }

  enable(isOn) { this.isOn = isOn; if (!isOn) this.show(0); }

  play(level) { if (this.isOn) this.show(level.amplitude); }

  show(amplitude) {
    document.body.classList.toggle("felt", amplitude > 0);
    document.body.style.setProperty("--amplitude", amplitude);
    document.body.style.setProperty("--felt", getComputedStyle(document.querySelector("main")).getPropertyValue("--state"));
  }
}

/** A tone, an octave above the vibration so that small loudspeakers play it. */
export class Tone {
  constructor() { this.isOn = false; this.audio = null; }

  /** Switch on or off; the first time must come from a click, or browsers stay silent. */
  enable(isOn) {
    this.isOn = isOn;
    if (isOn && !this.audio) this.build();
    if (isOn) this.audio.resume();
    else this.gain?.gain.setTargetAtTime(0, this.audio.currentTime, 0.005);
  }

  build() {
    this.audio = new AudioContext();
    this.gain = new GainNode(this.audio, { gain: 0 });
    this.voice = new OscillatorNode(this.audio, { type: "triangle" });
    this.voice.connect(this.gain).connect(this.audio.destination);
    this.voice.start();
  }

  play(level) {
    if (!this.isOn) return;
    const now = this.audio.currentTime;
    if (level.amplitude) this.voice.frequency.setTargetAtTime(2 * level.frequency_hz, now, 0.002);
    this.gain.gain.setTargetAtTime(0.4 * level.amplitude, now, 0.005);
  }
}
