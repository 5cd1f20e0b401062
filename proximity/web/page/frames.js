// Present state: the newest frame, which the client degrades as it ages, and the content of a log.

import { ContactFlag, FrameReader, Mode, STATE_NAMES, State, decode, flawOf } from "./proximity_client.mjs";

const MODE_NAMES = Object.fromEntries(Object.entries(Mode).map(([name, value]) => [value, name]));
const KNOWS_NOTHING = [State.STARTING, State.STALE, State.STOPPING];
export const MEANINGS = {
  LOADING: "The parts are loading.",
  "NO HANDS": "There are no hands. Distances are shown as soon as one is seen.",
  STARTING: "The service is running and has no hands yet.",
  LATE: "Poses or frames are late: only the bounds hold, and they widen.",
  STALE: "No frames come from the service: nothing is known of any finger.",
  STOPPING: "The service is stopping.",
};

const ms = (ns) => Number(ns) / 1e6;
export const nanoseconds = (at) => BigInt(Math.round(at * 1e6));

/** Frames as they arrive; for a log the newest is valid at any instant. */
export class Frames {
  isLogged = false;
  #reader = new FrameReader();
  #logged = null;

  /** Read the bytes of a frame; return its header, or null if invalid. */
  take(data, nowMs) {
    if (!this.isLogged) return this.#reader.offer(data, nanoseconds(nowMs)) ? null : this.#reader.at(nanoseconds(nowMs)).header;
    if (flawOf(data)) return null;
    this.#logged = decode(data);
    return this.#logged.header;
  }

  /** The state at an instant of this page, ms. */
  at(nowMs) {
    if (this.isLogged) return this.#ofLog();
    const { state, ageNs, contacts, header } = this.#reader.at(nanoseconds(nowMs));
    return { state, ageMs: header ? ms(ageNs) : NaN, contacts: contacts.map((each) => shownContact(each, State[state])), header };
  }

  #ofLog() {
    if (this.#logged === null) return { state: "STALE", ageMs: NaN, contacts: [], header: null };
    const { header, records } = this.#logged;
    const contacts = records.map((each) => shownContact(each, header.state, true));
    return { state: STATE_NAMES[header.state] ?? "STALE", ageMs: ms(header.publish_ns - header.pose_ns), contacts, header };
  }
}

/** The displayed state: whether numbers are current, of a service whose frames arrive. */
export function currentState({ state, contacts }) {
  if (state === "LATE" || state === "STOPPING") return state;
  return contacts.some((contact) => contact.isKnown) ? "OK" : "NO HANDS";
}

export function shownContact(record, state, isLogged = false) {
  const is = (flag) => (record.flags & ContactFlag[flag]) !== 0;
  const isKnown = !KNOWS_NOTHING.includes(state) && is("TRACKED");
  const isLate = state === State.LATE;
  const isOld = isLate && !isLogged;
  const contact = {
    finger: record.finger,
    isKnown,
    isExact: is("EXACT") && !isLate,
    isSigned: is("SIGNED"),
    part: record.part,
    position: record.position,
    pointOnFinger: record.point_on_finger,
    pointOnPart: record.point_on_part,
    normal: record.normal,
    velocity: record.velocity,
    distance: record.signed_distance,
    lower: record.lower,
    upper: record.upper,
    contactMs: isOld ? NaN : record.time_to_contact * 1e3,
    contactBend: !isOld && (is("CONTACT_FOUND") || is("ON_PATH")) ? record.contact_bend : NaN,
    mode: isKnown ? (MODE_NAMES[record.mode] ?? "") : "",
    work: record.work,
    isFar: !is("IN_RANGE"),
  };
  contact.isBound = isKnown && !contact.isExact && (isLate || (contact.isFar && contact.lower > 0));
  contact.isTouching = isKnown && !isLate && contact.distance <= 0;
  return contact;
}

/** The distance as text, in millimetres: a number, a bound, or that it may touch. */
export function shownDistance(contact) {
  if (!contact.isKnown) return "—";
  if (!contact.isBound) return mm(contact.distance);
  return contact.lower > 0 ? `≥ ${mm(contact.lower, 1)}` : "may touch";
}

/** A length in millimetres, as text: with the given number of decimals, or fewer the larger it is. */
export function mm(metres, digits) {
  if (metres === Infinity) return "∞";
  if (metres === -Infinity) return "−∞";
  if (!Number.isFinite(metres)) return "—";
  const size = Math.abs(metres) * 1e3;
  const shown = digits ?? (size >= 1000 ? 0 : size >= 100 ? 1 : 2);
  return (metres * 1e3).toFixed(shown).replace(/^-(?=[0.]*$)/, "").replace("-", "−");
}
