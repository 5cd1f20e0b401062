// What is known now: the newest frame, made worse as it ages. A number never stays when it does not hold.

import { ENUMS, RECORDS } from "./layout.js";
import { decode, readField } from "./message.js";

const { ContactFlag, State, Mode } = ENUMS;
export { ContactFlag, State, Mode };

/** ms after a frame's end of validity at which it is worth nothing, as subscribers have it. */
const STALE_AFTER_MS = 80;
/** ms after its oldest pose at which a frame is not valid, whatever it says. */
const LONGEST_VALID_MS = 1000;
/** m/s: no finger is faster; so fast bounds widen. */
const MAX_SPEED = 3;

const STATE_NAMES = Object.fromEntries(Object.entries(State).map(([name, value]) => [value, name]));
const MODE_NAMES = Object.fromEntries(Object.entries(Mode).map(([name, value]) => [value, name]));
export const MEANINGS = {
  STARTING: "The service is running and has no hands yet.",
  OK: "Every finger is tracked, and frames are in time.",
  DEGRADED: "",
  LATE: "Poses or frames are late: only the bounds hold, and they widen.",
  STALE: "No frames come from the service: nothing is known of any finger.",
  STOPPING: "The service is stopping.",
};

const NOTHING = { state: "STALE", ageMs: NaN, contacts: [], header: null };
const ms = (ns) => Number(ns) / 1e6;

/** When the tick of a frame began, ms of the service's clock. */
export const startOf = (frame) => ms(readField(new DataView(frame), 0, RECORDS.frame_header.fields.start_ns));

/** What a frame is worth at an instant of the service's clock, ms; of a log it is worth what it says. */
export function readingOf(frame, nowMs, isLogged) {
  if (frame === null) return NOTHING;
  const { header, records } = decode(frame);
  let state = STATE_NAMES[header.state] ?? "STALE";
  const ageMs = isLogged ? ms(header.publish_ns - header.pose_ns) : Math.max(nowMs - ms(header.pose_ns), 0);
  if (!isLogged && !(state === "STOPPING")) {
    const expires = Math.min(ms(header.valid_until_ns), ms(header.pose_ns) + LONGEST_VALID_MS);
    // Until the clocks are known nothing is: nan is not below anything.
    if (!(nowMs <= expires + STALE_AFTER_MS)) state = "STALE";
    else if (nowMs > expires && state !== "STALE") state = "LATE";
  }
  const contacts = records.map((record) => contactOf(record, state, nowMs, isLogged));
  return { state, ageMs, contacts, header };
}

function contactOf(record, state, nowMs, isLogged) {
  const is = (flag) => (record.flags & ContactFlag[flag]) !== 0;
  const isKnown = state !== "STALE" && state !== "STOPPING" && is("TRACKED");
  const contact = {
    finger: record.finger,
    isKnown,
    isExact: is("EXACT") && state !== "LATE",
    isSigned: is("SIGNED"),
    isTouching: false,
    part: record.part,
    position: record.position,
    pointOnFinger: record.point_on_finger,
    pointOnPart: record.point_on_part,
    normal: record.normal,
    velocity: record.velocity,
    distance: record.signed_distance,
    lower: record.lower,
    upper: record.upper,
    contactMs: record.time_to_contact * 1e3,
    contactBend: is("CONTACT_FOUND") || is("ON_PATH") ? record.contact_bend : NaN,
    mode: isKnown ? (MODE_NAMES[record.mode] ?? "") : "",
    work: record.work,
    isFar: !is("IN_RANGE"),
  };
  if (isKnown && state === "LATE" && !isLogged) widen(contact, record, nowMs);
  contact.isBound = isKnown && !contact.isExact && (state === "LATE" || (contact.isFar && contact.lower > 0));
  contact.isTouching = isKnown && state !== "LATE" && contact.distance <= 0;
  return contact;
}

/** What holds of a contact that is late: as far as finger and part may have come, less is known. */
function widen(contact, record, nowMs) {
  const elapsed = Math.max(nowMs - ms(record.pose_ns), 0) / 1e3;
  const way = elapsed * (MAX_SPEED + (Math.hypot(...record.part_velocity) || 0));
  contact.lower -= way;
  contact.upper += way;
  contact.distance = contact.lower;
  contact.contactMs = NaN;
  contact.contactBend = NaN;
}

/** The distance as one would say it, in millimetres: a number, a bound, or that it may touch. */
export function shownDistance(contact) {
  if (!contact.isKnown) return "—";
  if (!contact.isBound) return mm(contact.distance);
  return contact.lower > 0 ? `≥ ${mm(contact.lower, 1)}` : "may touch";
}

/** A length in millimetres, as text. */
export function mm(metres, digits = 2) {
  if (metres === Infinity) return "∞";
  if (metres === -Infinity) return "−∞";
  if (!Number.isFinite(metres)) return "—";
  const size = Math.abs(metres) * 1e3;
  const shown = size >= 1000 ? 0 : size >= 100 ? 1 : digits;
  return (metres * 1e3).toFixed(shown).replace("-", "−");
}
