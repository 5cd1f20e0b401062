// Playback of a log: at its own or another speed, or frame by frame.

import { byId } from "./panel.js";

const SPEEDS = [0.02, 0.1, 0.25, 0.5, 1, 2, 5, 20];

export class Timeline {
  constructor(link, { count, duration_ms: duration }) {
    Object.assign(this, { link, count, duration });
    this.ms = 0;
    this.place = 0;
    this.speed = 1;
    this.isPlaying = false;
    this.isAsked = false;
    byId("timeline").hidden = false;
    byId("log-at").max = duration;
    byId("log-speed").replaceChildren(...SPEEDS.map((speed) => new Option(`× ${speed}`, speed, speed === 1, speed === 1)));
    byId("log-speed").onchange = (event) => (this.speed = Number(event.target.value));
    byId("log-play").onclick = () => this.setPlaying(!this.isPlaying);
    byId("log-back").onclick = () => this.step(-1);
    byId("log-on").onclick = () => this.step(1);
    byId("log-at").oninput = (event) => {
      this.setPlaying(false);
      this.goTo(Number(event.target.value));
    };
    addEventListener("keydown", (event) => {
      if (event.target.closest?.("input, select, button")) return;
      if (event.code === "Space") this.setPlaying(!this.isPlaying);
      else if (event.key === ",") this.step(-1);
      else if (event.key === ".") this.step(1);
    });
    link.addEventListener("place", (event) => this.arrived(event.detail));
    this.goTo(0);
  }

  setPlaying(isPlaying) {
    if (isPlaying && this.ms >= this.duration) this.ms = 0;
    this.isPlaying = isPlaying;
    this.lastMs = performance.now();
    byId("log-play").textContent = isPlaying ? "Pause" : "Play";
    byId("log-play").setAttribute("aria-pressed", isPlaying);
  }

  /** Called before each picture. */
  update() {
    if (!this.isPlaying) return;
    const now = performance.now();
    this.ms = Math.min(this.ms + (now - this.lastMs) * this.speed, this.duration);
    this.lastMs = now;
    if (this.ms >= this.duration) this.setPlaying(false);
    if (!this.isAsked) this.goTo(this.ms);
  }

  goTo(ms) {
    this.ms = ms;
    this.isAsked = true;
    this.link.say({ at_ms: ms });
  }

  step(count) {
    this.setPlaying(false);
    this.isAsked = true;
    this.link.say({ place: Math.min(Math.max(this.place + count, 0), this.count - 1) });
  }

  arrived({ place, ms }) {
    this.isAsked = false;
    this.place = place;
    if (!this.isPlaying) this.ms = ms;
    byId("log-at").value = ms;
    byId("log-time").textContent = `${(ms / 1e3).toFixed(3)} s · ${place + 1} of ${this.count}`;
  }
}
