// The engine in the page: computes the answers that Link requests from a service.

import { nanoseconds, shownContact } from "./frames.js";
import { PATH_CORNERS, ENUMS } from "./layout.mjs";
import { Rate } from "./link.js";

const { State, PartAction } = ENUMS;
const NOTHING = { state: "LOADING", ageMs: NaN, contacts: [], header: null };

export class LocalLink extends EventTarget {
  /** *welcome*: the page's data on its parts and fingers. *local*: a LocalScene. */
  constructor(welcome, local) {
    super();
    this.latencies = [];
    this.rate = new Rate();
    this.count = 0; // of ticks
    this.begin(welcome, local).catch((failure) => this.emit("closed", { sentence: failure.message, isFinal: true }));
  }

  async begin(welcome, local) {
    const { finger_count: count, radii, budget, tracker } = welcome;
    this.positions = new Float64Array(3 * count).fill(NaN);
    this.corners = new Float64Array(3 * PATH_CORNERS * count).fill(NaN);
    this.bends = new Float64Array(count).fill(NaN);
    this.instants = new Array(count).fill(0n);
    await null; // until a listener is set
    this.emit("welcome", welcome);
    this.scene = await local.open();
    const settings = { budget };
    for (const [name, value] of Object.entries(tracker)) settings[name.replace(/_./g, (end) => end[1].toUpperCase())] = value;
    this.tracker = this.scene.tracker(count, settings);
    radii.forEach((radius, finger) => this.tracker.setRadius(finger, radius));
  }

  /** The state at an instant, ms: computed now, for the last positions of the fingers. */
  at(nowMs) {
    if (!this.tracker) return NOTHING;
    const now = nanoseconds(nowMs), { corners, bends } = this;
    const isTracked = this.positions.some(Number.isFinite);
    if (!isTracked && !this.wasTracked) return { state: "NO HANDS", ageMs: NaN, contacts: [], header: { start_ns: now } };
    this.wasTracked = isTracked; // the tracker learns once that no finger is
    const began = performance.now();
    const records = this.tracker.tick(this.positions, this.instants, now, { corners, bends });
    this.latencies.push(performance.now() - began);
    if (this.latencies.length > 600) this.latencies.shift();
    this.rate.add(nowMs, ++this.count);
    const contacts = records.map((record, finger) => shownContact({ ...record.copy(), finger }, State.OK));
    const ages = contacts.filter((each) => each.isKnown).map(({ finger }) => Number(now - this.instants[finger]) / 1e6);
    return { state: ages.length ? "OK" : "NO HANDS", ageMs: Math.max(...ages), contacts, header: { start_ns: now } };
  }

  /** Set fingers, each with its position at *atMs*; without a position it is not tracked. */
  sendPoses(fingers, atMs) {
    for (const { finger, position, corners, bend } of fingers) {
      this.positions.set(position ?? [NaN, NaN, NaN], 3 * finger);
      this.corners.set(corners ?? [NaN, NaN, NaN], 3 * PATH_CORNERS * finger);
      this.bends[finger] = bend ?? NaN;
      this.instants[finger] = nanoseconds(atMs);
    }
  }

  /** Set poses of parts: name, rotation row by row, translation. */
  sendMoves(moves) {
    if (!this.tracker || !moves.length) return;
    const matrixOf = ({ rotation: r, translation: t }) =>
      [r[0], r[1], r[2], t[0], r[3], r[4], r[5], t[1], r[6], r[7], r[8], t[2], 0, 0, 0, 1];
    this.scene.move(moves.map((move) => ({ part: move.name, matrix: matrixOf(move) })));
    const now = nanoseconds(performance.now());
    this.emit("moves", moves.map((move) => ({ ...move, pose_ns: now })));
    this.emit("frame", { start_ns: now });
  }

  sendChanges(changes) {
    if (!this.tracker) return;
    for (const { name, action } of changes) this.scene.hide(name, action === PartAction.HIDE);
    this.emit("changes", changes);
  }

  emit(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}
