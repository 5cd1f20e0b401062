// proximity_client.mjs: messages of a proximity service, read, written and aged, in browsers and Node.
//
// Made by `proximity client js`; edits are lost. 64-bit integers, including instants, are BigInt. A field of several
// numbers is an array, row-major. This module has no network: proximity_udp.mjs has one for Node, and in a browser
// bytes come from a WebSocket.

import { CHECKED_FROM, ENUMS, KINDS, LIMITS, MAX_RECORDS, RECORDS, VERSION } from "./layout.mjs";

const { ContactFlag, Mode, PartAction, Source, State, Surface } = ENUMS;
export { ContactFlag, Mode, PartAction, Source, State, Surface };
export const STATE_NAMES = Object.keys(State);

const utf8 = new TextEncoder();
const text = new TextDecoder();

const CRC_TABLE = new Uint32Array(256).map((_, byte) => {
  let crc = byte;
  for (let bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
  return crc;
});

/** The CRC-32 of zlib. */
export function crc32(bytes) {
  let crc = 0xffffffff;
  for (let i = 0; i < bytes.length; i++) crc = (crc >>> 8) ^ CRC_TABLE[(crc ^ bytes[i]) & 0xff];
  return (crc ^ 0xffffffff) >>> 0;
}

const viewOf = (bytes) =>
  bytes instanceof ArrayBuffer ? new DataView(bytes) : new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);

function readField(view, offset, field) {
  const start = offset + field.offset;
  if (field.type === "Text") {
    const bytes = new Uint8Array(view.buffer, view.byteOffset + start, field.count);
    const end = bytes.indexOf(0);
    return text.decode(end < 0 ? bytes : bytes.subarray(0, end));
  }
  const get = `get${field.type}`;
  if (field.count === 1) return view[get](start, true);
  return Array.from({ length: field.count }, (_, k) => view[get](start + k * field.size, true));
}

/** Read a record at an offset, by its layout in RECORDS. */
export function readRecord(view, offset, record) {
  const values = {};
  for (const [name, field] of Object.entries(record.fields)) {
    if (name !== "reserved") values[name] = readField(view, offset, field);
  }
  return values;
}

/** Throw for values outside a field's range: a DataView throws without its name, or writes them as NaN. */
function checkTypes(name, field, numbers) {
  const isWide = field.type.startsWith("Big");
  for (const value of numbers) {
    const kind = typeof value;
    if (isWide ? kind !== "bigint" : kind !== "number" && kind !== "boolean") {
      throw new TypeError(`${name} is ${kind === "string" ? `"${value}"` : `${value} (${kind})`}, expected a ${isWide ? "BigInt, such as 5n" : "number"}`);
    }
  }
}

function writeRecord(view, offset, record, values) {
  for (const [name, value] of Object.entries(values)) {
    const field = record.fields[name];
    if (field === undefined) throw new TypeError(`there is no field "${name}" (expected ${Object.keys(record.fields).join(", ")})`);
    if (field.type === "Text") {
      const bytes = utf8.encode(value);
      if (bytes.length > field.count) throw new RangeError(`"${value}" has ${bytes.length} bytes, expected at most ${field.count}`);
      new Uint8Array(view.buffer, view.byteOffset + offset + field.offset, field.count).set(bytes);
      continue;
    }
    const numbers = field.count === 1 ? [value] : value;
    if (numbers?.length !== field.count) {
      throw new RangeError(`${name} has ${numbers?.length ?? "no"} numbers, expected ${field.count}`);
    }
    checkTypes(name, field, numbers);
    for (let k = 0; k < field.count; k++) view[`set${field.type}`](offset + field.offset + k * field.size, numbers[k], true);
  }
}

/** Return an unset record: numbers with a fraction are NaN, rotations the identity. */
function beginRecord(view, offset, record, zeros) {
  for (const [name, field] of Object.entries(record.fields)) {
    if (field.type !== "Float64" || zeros.includes(name)) continue;
    for (let k = 0; k < field.count; k++) {
      view.setFloat64(offset + field.offset + 8 * k, name === "rotation" ? Number(k % 4 === 0) : NaN, true);
    }
  }
}

/** Return the defect of bytes that claim to be a message of a kind, or "". The bytes are untrusted. */
export function flawOf(bytes, kind = "frame") {
  const { magic, header, record } = KINDS[kind];
  const [head, row] = [RECORDS[header], RECORDS[record]];
  const view = viewOf(bytes);
  if (view.byteLength < head.size) return "short";
  const at = (name) => readField(view, 0, head.fields[name]);
  if (at("magic") !== magic) return "magic";
  if (at("version") !== VERSION) return "version";
  const count = (view.byteLength - head.size) / row.size;
  const isWhole = at("size") === view.byteLength && at("header_size") === head.size;
  if (!isWhole || !Number.isInteger(count) || count > MAX_RECORDS) return "size";
  const checked = new Uint8Array(view.buffer, view.byteOffset + CHECKED_FROM, view.byteLength - CHECKED_FROM);
  if (crc32(checked) !== at("checksum")) return "checksum";
  return at("count") === count ? "" : "size";
}

/** Test whether bytes claim to be a description: names of parts and fingers. */
function isDescription(bytes) {
  const view = viewOf(bytes);
  return view.byteLength >= RECORDS.prefix.size && view.getUint32(0, true) === KINDS.description.magic;
}

/** Read a message without a defect: its header and records. */
export function decode(bytes, kind = "frame") {
  const [head, row] = [RECORDS[KINDS[kind].header], RECORDS[KINDS[kind].record]];
  const view = viewOf(bytes);
  const header = readRecord(view, 0, head);
  const records = Array.from({ length: header.count }, (_, k) => readRecord(view, head.size + k * row.size, row));
  return { header, records };
}

/** Write a message of a kind such as "poses"; *header* has at least send_ns, session and sequence. A field that a
 * record does not name is unset: NaN, of rotations the identity. */
export function encode(kind, header, records) {
  if (KINDS[kind] === undefined) throw new TypeError(`there is no kind "${kind}" (expected ${Object.keys(KINDS).join(", ")})`);
  if (records.length > MAX_RECORDS) throw new RangeError(`${records.length} records, expected 0 to ${MAX_RECORDS}`);
  const { magic, header: headerName, record: recordName } = KINDS[kind];
  const [head, row] = [RECORDS[headerName], RECORDS[recordName]];
  const bytes = new Uint8Array(head.size + records.length * row.size);
  const view = viewOf(bytes);
  const known = { magic, version: VERSION, header_size: head.size, size: bytes.length, count: records.length };
  writeRecord(view, 0, head, { ...header, ...known });
  records.forEach((values, k) => {
    beginRecord(view, head.size + k * row.size, row, KINDS[kind].zeros);
    writeRecord(view, head.size + k * row.size, row, values);
  });
  view.setUint32(head.fields.checksum.offset, crc32(bytes.subarray(CHECKED_FROM)), true);
  return bytes;
}

/** A record of "poses": a finger whose centre is there, m; velocity and bend are not known. */
export const poseOf = (finger, position, poseNs) => ({ finger, pose_ns: poseNs, position });

/** A record of "moves": a part at rest, not turned, with its origin there, m. */
export const moveOf = (name, translation, poseNs) => ({
  name, pose_ns: poseNs, translation, rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1],
  velocity: [0, 0, 0], angular_velocity: [0, 0, 0],
});

/** A record of "changes": PartAction.HIDE, SHOW or REMOVE a part. */
export const changeOf = (name, action) => ({ name, action });

/** A record of "additions": a file of a folder of `parts_from`, not turned, with its origin there, m. */
export const additionOf = (name, file, translation) => ({
  name, file, units: "", translation, rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1],
});

const length = (v) => Math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
const least = (a, b) => (Number.isNaN(a) ? b : Number.isNaN(b) ? a : Math.min(a, b)); // ignore nan
const most = (a, b) => (Number.isNaN(a) ? b : Number.isNaN(b) ? a : Math.max(a, b));
const larger = (a, b) => (a > b ? a : b);

/** Widen a contact's bounds by the possible motion of finger and parts until then; its distance is that of its pose. */
export function widen(c, nowNs, maxSpeed = 3, maxAcceleration = 120) {
  const isTracked = (c.flags & ContactFlag.TRACKED) !== 0;
  const isGeometry = c.source === Source.GEOMETRY;
  const partSpeed = most(length(c.part_velocity), 0);
  const limit = maxSpeed + partSpeed;
  let going = isGeometry ? length(c.velocity.map((x, k) => x - c.part_velocity[k])) : Math.abs(c.approach_speed);
  // The uncertainty of that velocity, and the excess of other parts' velocities, are in the predictions.
  const lead = 1e-9 * Number(c.predicted_ns - c.pose_ns);
  let spread = c.predicted_upper - c.predicted_lower - (isGeometry ? 0 : c.upper - c.lower);
  spread *= 0.5 / lead;
  const isFinite = lead > 0 && spread < Infinity;
  if (!isFinite) spread = 0;
  if (!(spread < maxSpeed)) going = most(going, partSpeed); // it may be that of a finger that could turn round
  const isKnown = (c.flags & ContactFlag.PREDICTED) !== 0 && isFinite;
  const atFirst = isKnown ? going + spread : NaN;
  const atLast = isKnown ? limit + spread : larger(limit, partSpeed + spread);
  c.age_ns = nowNs - c.pose_ns;
  const elapsed = larger(1e-9 * Number(c.age_ns), 0);
  const drift = least(atFirst + 0.5 * maxAcceleration * elapsed, atLast) * elapsed;
  c.lower = c.predicted_lower = c.lower - drift;
  c.upper = c.predicted_upper = c.upper + drift;
  const free = elapsed + Math.max(c.lower, 0) / larger(limit + spread, 2 ** -1022);
  c.time_to_contact_lower = Math.min(c.time_to_contact_lower, free);
  c.predicted_distance = c.signed_distance;
  c.predicted_ns = nowNs;
  c.contact_bend_error += Infinity;
  c.force_is_valid = 0;
  const { EXACT, SKIPPED, PREDICTED, CONTACT_FOUND, BOUNDED } = ContactFlag;
  c.flags = ((c.flags & ~(EXACT | SKIPPED | PREDICTED | CONTACT_FOUND)) | (isTracked ? BOUNDED : 0)) >>> 0;
  return c;
}

/** Reset a contact, except its finger, source and instant. */
export function forget(c) {
  for (const [name, field] of Object.entries(RECORDS.contact.fields)) {
    if (field.type === "Float64") c[name] = field.count === 1 ? NaN : new Array(field.count).fill(NaN);
  }
  const nothing = {
    lower: -Infinity, predicted_lower: -Infinity, upper: Infinity, predicted_upper: Infinity,
    time_to_contact_lower: 0, flags: 0, part: -1, face: -1, force_is_valid: 0,
  };
  return Object.assign(c, nothing, { surface: Surface.UNKNOWN, mode: Mode.HOLD });
}

/** The clock of a publisher on another machine, by the fastest message; see docs/reference/messages.md. */
class ForeignClock {
  isCertain = false;
  #session = null;
  #offset = 0n;
  #seen = 0n;
  #first = 0n;
  #firstOffset = 0n;
  #sent = null;
  #former = null;

  hear(session, sent, now) {
    const offset = now - sent;
    const fastest = grown(this.#offset, this.#seen, now);
    const pace = grown(LIMITS.PACE_NS, this.#first, now);
    const isNewRun = this.#session !== null && this.#session !== session;
    this.#session = session;
    if (this.#sent === null || sent < this.#sent - LIMITS.BACK_NS || (isNewRun && offset > fastest + LIMITS.JUMP_NS)) {
      const before = this.#former === null ? offset : grown(...this.#former, now);
      this.#former = null;
      this.#begin(offset > before && offset <= before + LIMITS.JUMP_NS ? before : offset, now);
    } else if (offset < this.#firstOffset - pace) {
      if (this.isCertain) this.#former = [this.#offset, this.#seen];
      this.#begin(offset, now);
    } else {
      this.#offset = offset < fastest ? offset : fastest;
      this.#seen = now;
      if (offset <= this.#firstOffset + pace && now - this.#first >= LIMITS.SETTLING_NS) {
        this.isCertain = true;
        this.#former = null;
      }
      if (sent < this.#sent) return;
    }
    this.#sent = sent;
  }

  #begin(offset, now) {
    this.isCertain = false;
    this.#offset = this.#firstOffset = offset;
    this.#seen = this.#first = now;
  }

  /** A lower estimate of the publisher's clock. */
  theirs = (now) => (this.#sent === null ? now : now - this.#offset + LIMITS.TRANSIT_NS);
}

const grown = (offset, seen, now) => offset + (now > seen ? now - seen : 0n) / LIMITS.NS_PER_DRIFT;

/** Validates frames and ages the newest; without a network. Instants are of this machine's clock, ns, BigInt. */
export class FrameReader {
  counts = { received: 0, lost: 0n, sessions: 0, refused: 0, unverified: 0, flawed: {} };
  refused = 0n; // changes, additions, deformations and moves that the service has refused
  refusal = ""; // the last of them: its kind and the reason
  #isShared;
  #isKeyed;
  #limits;
  #clock = new ForeignClock();
  #last = null;
  #newestSession = 0n;
  #ended = new Map(); // session: the last number of a run before
  #held = null;
  #isNew = false;
  #nowNs = null; // of the last reading, publisher's clock; null if it is not known
  #valid = new Map(); // finger: its newest valid contact, while parts keep their numbers
  #names = null; // of a description: numbers of its service, and the names of parts
  #labels = { of: "", names: new Map() }; // of an incomplete description

  constructor({ sharesClock = false, isKeyed = false, staleAfter = 0.08, maxSpeed = 3, maxAcceleration = 120 } = {}) {
    for (const [name, value] of Object.entries({ staleAfter, maxSpeed, maxAcceleration })) {
      if (!(value >= 0 && value < Infinity)) throw new RangeError(`${name} is ${value}, expected a number of 0 or more`);
    }
    this.#isShared = sharesClock;
    this.#isKeyed = isKeyed;
    this.#limits = { staleAfterNs: BigInt(Math.round(1e9 * staleAfter)), maxSpeed, maxAcceleration };
  }

  /** Read the bytes of a frame, or a description, that arrived; return their defect, or "". */
  offer(bytes, nowNs) {
    const flaw = isDescription(bytes) ? this.#describe(bytes) : this.#judge(bytes, nowNs);
    if (flaw) this.counts.flawed[flaw] = (this.counts.flawed[flaw] ?? 0) + 1;
    return flaw;
  }

  /** The present state: state, isValid, isNew, nowNs (publisher's clock), ageNs (-1n: no frame), header, contacts. */
  at(nowNs) {
    const isBelieved = this.#isShared || this.#clock.isCertain;
    const now = this.#isShared ? nowNs : this.#clock.theirs(nowNs);
    const held = this.#held;
    this.#nowNs = isBelieved ? now : null;
    if (held === null) return { state: "STALE", isValid: false, isNew: false, nowNs: now, ageNs: -1n, header: null, contacts: [] };
    const { header } = held;
    const ends = header.pose_ns + LIMITS.MAX_VALID_NS;
    const expires = header.valid_until_ns < ends ? header.valid_until_ns : ends;
    let state = header.state;
    if (!isBelieved || now > expires + this.#limits.staleAfterNs) state = Math.max(state, State.STALE);
    else if (now > expires) state = Math.max(state, State.LATE);
    const isValid = state === State.OK || state === State.DEGRADED;
    const age = now - header.pose_ns;
    const isNew = this.#isNew;
    this.#isNew = false;
    const contacts = isValid ? held.records : held.records.map((record) => this.#worsened({ ...record }, state, header.state, now));
    return { state: STATE_NAMES[state], isValid, isNew, nowNs: now, ageNs: age > 0n ? age : 0n, header, contacts };
  }

  /** The newest valid contact of a finger, as published, whose pose is at most that old at the last reading; null if
   * there is none. For a display, while frames are late. */
  lastValid(finger, atMostNs = 100_000_000n) {
    const contact = this.#valid.get(finger);
    return contact !== undefined && this.#nowNs !== null && this.#nowNs - contact.pose_ns <= atMostNs ? contact : null;
  }

  /** The name of a part of the newest frame, which numbers it as contact.part; "" until it is known, within a
   * second of the first frame and of each change. */
  partName(part) {
    if (this.#held === null || this.#names === null) return "";
    const { session, epoch } = this.#held.header;
    return session === this.#names.session && epoch === this.#names.epoch ? (this.#names.parts[part] ?? "") : "";
  }

  /** Read one message of a description, whose names are used once it is complete. */
  #describe(bytes) {
    const flaw = flawOf(bytes, "description");
    if (flaw) return flaw;
    const { header, records } = decode(bytes, "description");
    const { session, epoch, part_count: partCount, finger_count: fingerCount, first } = header;
    const total = partCount + fingerCount;
    if (total > LIMITS.MAX_NAMES || first + records.length > total) return "content";
    ({ refused: this.refused, refusal: this.refusal } = header);
    const of = [session, epoch, partCount, fingerCount].join();
    if (of !== this.#labels.of || first === 0) this.#labels = { of, names: new Map() };
    const { names } = this.#labels;
    records.forEach((record, k) => names.set(first + k, record.name));
    if (names.size === total) {
      this.#names = { session, epoch, parts: Array.from({ length: partCount }, (_, row) => names.get(row)) };
    }
    return "";
  }

  #worsened(contact, state, published, now) {
    if (state !== State.LATE || published === State.STARTING) return forget(contact);
    return widen(contact, now, this.#limits.maxSpeed, this.#limits.maxAcceleration);
  }

  #judge(bytes, now) {
    const flaw = flawOf(bytes);
    if (flaw) return flaw;
    const frame = decode(bytes);
    const { session, sequence, publish_ns: sent } = frame.header;
    if (this.#isOld(session, sequence, sent, now)) return "old";
    const wrong = contentFlaw(frame, this.#isShared ? now : sent);
    if (wrong) return wrong;
    this.#accept(session, sequence, sent, now);
    const before = this.#held?.header;
    if (before?.session !== session || before.epoch !== frame.header.epoch) this.#valid.clear();
    for (const contact of [State.OK, State.DEGRADED].includes(frame.header.state) ? frame.records : []) {
      if ((contact.flags & ContactFlag.TRACKED) !== 0) this.#valid.set(contact.finger, contact);
    }
    this.#held = frame;
    this.#isNew = true;
    return "";
  }

  #isOld(session, sequence, sent, now) {
    if (this.#isKeyed && session < this.#newestSession) return true; // with a key it may be a recording
    const last = this.#last;
    if (last === null) return false;
    if (session === last.session) {
      return sequence <= last.sequence || sequence - last.sequence > LIMITS.MAX_SKIPPED;
    }
    const wasFollowed = this.#ended.has(session);
    if (session > last.session && !wasFollowed) return false;
    const isSilent = now - last.now > LIMITS.RESTART_SILENCE_NS;
    if (wasFollowed) return !(isSilent && sequence > this.#ended.get(session));
    return !(this.#isShared ? sent > last.sent : isSilent);
  }

  #accept(session, sequence, sent, now) {
    const last = this.#last;
    let before = sequence - 1n; // no message is missing before the first
    if (last === null || last.session !== session) this.counts.sessions++;
    if (last !== null && last.session === session) before = last.sequence;
    else if (last !== null) {
      this.#ended.set(last.session, last.sequence);
      before = this.#ended.get(session) ?? -1n;
      this.#ended.delete(session);
      if (this.#ended.size > LIMITS.MAX_RUNS) this.#ended.delete(this.#ended.keys().next().value);
    }
    const missing = sequence - before - 1n;
    this.counts.lost += missing <= LIMITS.MAX_SKIPPED ? missing : 0n; // of a run that was joined late
    this.counts.received++;
    this.#last = { session, sequence, sent, now };
    if (session > this.#newestSession) this.#newestSession = session;
    if (!this.#isShared) this.#clock.hear(session, sent, now);
  }
}

function contentFlaw({ header, records }, base) {
  if (header.state > State.STOPPING || header.source > Source.HELD) return "content";
  const latest = base + LIMITS.AHEAD_NS < LIMITS.LAST_NS ? base + LIMITS.AHEAD_NS : LIMITS.LAST_NS;
  if (header.pose_ns > latest || header.publish_ns > latest) return "future";
  if (header.pose_ns < 0n || header.publish_ns < 0n) return "content";
  return records.every((c) => isSound(c, header.pose_ns, latest)) ? "" : "content";
}

function isSound(c, earliest, latest) {
  const isKind = c.surface <= Surface.DEFORMABLE && c.mode <= Mode.HOLD && c.source <= Source.HELD && c.force_is_valid <= 1;
  if (!isKind || (c.flags & ContactFlag.TRACKED) === 0) return isKind;
  const isPlaced = c.position.every(Number.isFinite) || (c.source !== Source.GEOMETRY && c.position.some(Number.isNaN));
  const [x, y, z] = c.normal;
  const normalSq = x * x + y * y + z * z;
  return (
    c.lower <= c.signed_distance && c.signed_distance <= c.upper && c.predicted_lower <= c.predicted_upper &&
    !Number.isNaN(c.predicted_distance) && c.time_to_contact_lower <= c.time_to_contact && isPlaced &&
    !(normalSq < (1 - LIMITS.UNIT_ERROR) ** 2 || normalSq > (1 + LIMITS.UNIT_ERROR) ** 2) && // nan: no normal
    c.pose_ns >= earliest && c.pose_ns <= latest
  );
}
