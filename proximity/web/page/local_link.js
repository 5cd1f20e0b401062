// The engine in the page itself, for a page that was saved: what Link asks of a service is computed here.

import { MEANINGS, shownContact } from "./frames.js";
import { Rate, nanoseconds } from "./link.js";
import { ENUMS } from "./layout.mjs";
import { load } from "./proximity.mjs";

const { State, PartAction } = ENUMS;

export class LocalLink extends EventTarget {
  /** *saved*: what the file has: welcome, scene, geometry, and the engine's module that fits. */
  constructor(saved) {
    super();
    this.isOpen = false;
    this.frames = this; // there is nothing between a question and its answer
    this.isLogged = false;
    this.latencies = [];
    this.rate = new Rate();
    this.count = 0; // of ticks
    this.begin(saved).catch((failure) => this.emit("closed", { sentence: failure.message, isFinal: true }));
  }

  async begin({ welcome, scene, geometry, engine }) {
    this.scene = (await load(engine)).open(scene);
    const { finger_count: count, radii, budget } = welcome;
    this.tracker = this.scene.tracker(count, { budget });
    radii.forEach((radius, finger) => this.tracker.setRadius(finger, radius));
    this.positions = new Float64Array(3 * count).fill(NaN);
    this.instants = new Array(count).fill(0n);
    this.isOpen = true;
    this.emit("welcome", welcome);
    this.emit("glb", geometry);
  }

  /** What is known at an instant, ms: it is computed now, for where the fingers were last. */
  at(nowMs) {
    if (!this.isOpen) return { state: "STALE", ageMs: NaN, contacts: [], header: null };
    const now = nanoseconds(nowMs);
    const began = performance.now();
    const records = this.tracker.tick(this.positions, this.instants, now);
    this.rate.add(nowMs, ++this.count);
    this.took(performance.now() - began);
    const isTracked = (finger) => Number.isFinite(this.positions[3 * finger]);
    const tracked = records.filter((_, finger) => isTracked(finger)).length;
    const state = tracked === 0 ? "STARTING" : tracked < records.length ? "DEGRADED" : "OK";
    const contacts = records.map((record, finger) => shownContact({ ...record, finger }, State[state]));
    const ages = this.instants.filter((_, finger) => isTracked(finger)).map((instant) => Number(now - instant) / 1e6);
    return { state, ageMs: ages.length ? Math.max(...ages) : NaN, contacts, header: { missed: 0, start_ns: now } };
  }

  took(ms) {
    this.latencies.push(ms);
    if (this.latencies.length > 600) this.latencies.shift();
  }

  /** Take fingers, of which each is where it was at *atMs*; without a position it is not tracked. */
  sendPoses(fingers, atMs) {
    if (!this.isOpen) return;
    for (const { finger, position } of fingers) {
      this.positions.set(position ?? [NaN, NaN, NaN], 3 * finger);
      this.instants[finger] = nanoseconds(atMs);
    }
  }

  /** Put parts elsewhere: name, rotation row by row, translation. */
  sendMoves(moves) {
    if (!this.isOpen || !moves.length) return;
    const matrixOf = ({ rotation: r, translation: t }) =>
      [r[0], r[1], r[2], t[0], r[3], r[4], r[5], t[1], r[6], r[7], r[8], t[2], 0, 0, 0, 1];
    this.scene.move(moves.map((move) => ({ part: move.name, matrix: matrixOf(move) })));
    const now = nanoseconds(performance.now());
    this.emit("moves", moves.map((move) => ({ ...move, pose_ns: now })));
    this.emit("frame", { start_ns: now });
  }

  sendChanges(changes) {
    for (const { name, action } of changes) this.scene.hide(name, action === PartAction.HIDE);
    this.emit("changes", changes);
  }

  say(what) {
    if (what.slice) this.emit("slice", this.sliced(what.slice));
    if (what.clearance) this.emit("notice", "A saved page measures between points; parts are measured by proximity view.");
  }

  /** The signed distance on a plane. */
  sliced({ ticket, origin, u, v, width, height }) {
    const points = new Float64Array(3 * width * height);
    for (let row = 0, at = 0; row < height; row++) {
      for (let column = 0; column < width; column++) {
        for (let k = 0; k < 3; k++) points[at++] = origin[k] + (row / (height - 1)) * v[k] + (column / (width - 1)) * u[k];
      }
    }
    const values = Float32Array.from(this.scene.signedDistance(points));
    const finite = values.filter(Number.isFinite);
    const lowest = finite.reduce((a, b) => Math.min(a, b), Infinity);
    const highest = finite.reduce((a, b) => Math.max(a, b), -Infinity);
    return { ticket, origin, u, v, width, height, lowest, highest, values };
  }

  emit(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}

MEANINGS.STARTING = "Distances are computed in this page. There are no hands yet.";
