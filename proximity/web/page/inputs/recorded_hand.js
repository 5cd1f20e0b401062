// A recorded hand, replayed repeatedly: fingertips only.

const EVERY_MS = 11;
const PAUSE_MS = 150; // between two rounds the hand is absent: it has not jumped

export class RecordedHand {
  constructor(recording, send) {
    this.recording = recording;
    this.send = send;
    this.joints = null;
    this.isOn = false;
    this.hint = recording ? `${recording.name}, repeated.` : "No recorded hand was given: start with --replay HAND.";
  }

  start() {
    if (this.isOn || !this.recording) return;
    this.isOn = true;
    this.beganMs = performance.now();
    this.timer = setInterval(() => this.step(), EVERY_MS);
  }

  stop() {
    if (!this.isOn) return;
    this.isOn = false;
    clearInterval(this.timer);
    this.send([]);
  }

  step() {
    const { positions, step_ms: step, fingers } = this.recording;
    const now = performance.now();
    const round = (positions.length - 1) * step + PAUSE_MS;
    const at = ((now - this.beganMs) % round) / step;
    const row = Math.floor(at);
    if (row >= positions.length - 1) return this.send([], now);
    const [from, to] = [positions[row], positions[row + 1]];
    const found = [];
    fingers.forEach((finger, k) => {
      const position = [0, 1, 2].map((i) => {
        const [a, b] = [from[3 * k + i], to[3 * k + i]];
        return a === null || b === null ? NaN : a + (b - a) * (at - row);
      });
      if (position.every(Number.isFinite)) found.push({ finger, position });
    });
    this.send(found, now);
  }
}
