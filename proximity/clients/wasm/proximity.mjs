// proximity.mjs: exact distances, rays and segments against the parts of a compiled scene, computed locally: in
// browsers, workers and Node, without a service.
//
// Made by `proximity library wasm`; edits are lost. A scene is the bytes of a file "....prox", written by
// `proximity compile`. Lengths are in metres, in the scene's frame. Points are a Float64Array, or any array of
// numbers, three a point; matrices have 16 numbers, row-major, "scene from part". Answers equal those of the Python
// package, bit for bit if the processor fuses multiply-add and the browser has relaxed vector instructions, as
// almost all have; see `Engine.instructions`.

import { ContactFlag, RECORDS } from "./layout.mjs";

export { ContactFlag };

/** Records of answers: names of the numbers of eight bytes, then those of four. */
const CLOSEST = { size: 96, reals: { signedDistance: 1, point: 3, gradient: 3, barycentric: 3 },
  words: ["part", "face", "feature", "isSigned"] };
const HIT = { size: 88, reals: { distance: 1, point: 3, normal: 3, barycentric: 3 }, words: ["part", "face"] };
const SEGMENT = { size: 96, reals: { distance: 1, pointOnSegment: 3, pointOnSolid: 3, fraction: 1, barycentric: 3 },
  words: ["part", "face"] };
const CLEARANCE = { size: 80, reals: { lower: 1, distance: 1, pointOnFirst: 3, pointOnSecond: 3 },
  words: ["faceOnFirst", "faceOnSecond", "relation"] };
const PENETRATION = { size: 80, reals: { depth: 1, lower: 1, direction: 3, deepest: 1, deepestLower: 1, deepestPoint: 3 },
  words: [] };
const PART_SETTINGS = ["workingRange", "tolerance", "latency", "horizon"];
const CONNECTION = fieldsOf(["Uint32", "flags", "work"], ["Int32", "part", "own_part", "face", "own_face"],
  ["BigInt64", "pose_ns", "age_ns"], ["Float64", "distance", "lower", "upper", ["point_on_own", 3], ["point_on_part", 3],
    ["normal", 3], "approach_speed"], ["BigInt64", "predicted_ns"], ["Float64", "predicted_distance", "predicted_lower",
    "predicted_upper", "time_to_contact", "time_to_contact_lower", "depth", "depth_lower"]);
const ERROR_SIZE = 512;
const SETTINGS = ["radius", "latency", "workingRange", "tolerance", "horizon", "maxSpeed", "maxAcceleration"];
const SETTINGS_SIZE = 64;
const PATHS_SIZE = 16; // of proximity_paths: an address, a count, two addresses
// A function with one relaxed instruction, which is valid if the browser supports them.
const RELAXED = new Uint8Array([
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 15, 1, 13, 0, 65, 1, 253, 15, 65, 2, 253, 15,
  253, 128, 2, 11,
]);
const text = new TextDecoder();

/** The layout of a record, from lists of a type and names. */
function fieldsOf(...groups) {
  const fields = {};
  let offset = 0;
  for (const [type, ...names] of groups) {
    for (const [name, count] of names.map((each) => (typeof each === "string" ? [each, 1] : each))) {
      const size = type.endsWith("32") ? 4 : 8;
      fields[name] = { type, size, offset, count };
      offset += size * count;
    }
  }
  return { size: offset, fields };
}

export const NO_PART = -1, NO_FACE = -1;
export const Relation = { APART: 0, TOUCHING: 1, CROSSING: 2, FIRST_INSIDE: 3, SECOND_INSIDE: 4 };
/** Flags of a connection; the first ones are those of a contact. */
export const ConnectionFlag = { PREDICTED: 2, EXACT: 4, BOUNDED: 8, SKIPPED: 16, INSIDE: 64, IN_RANGE: 128,
  PART_CHANGED: 256, CROSSING: 4096 };
export const Feature = { NONE: -1, FACE: 0, EDGE: 1, VERTEX: 2 };

export const ErrorCode = { // as in proximity.h; BAD_VERSION: a scene of another version, to be compiled again
  BAD_ARGUMENT: 1, NO_MEMORY: 2, NO_FILE: 3, BAD_FILE: 4, BAD_POSE: 5, NO_INSIDE: 6, NO_PROCESSOR: 7, BROKEN: 8, BAD_VERSION: 9,
  BAD_MESH: 10,
};

/** An error: its message gives the cause, the place and the expected input. */
export class ProximityError extends Error {
  constructor(code, sentence) {
    super(sentence);
    this.name = "ProximityError";
    this.code = code; // as in proximity.h
  }
}

/** Test whether the browser has relaxed vector instructions, and uses proximity.relaxed.wasm. */
export const hasRelaxed = () => typeof WebAssembly !== "undefined" && WebAssembly.validate(RELAXED);

/** Start an engine. *source*: the bytes or the compiled module of one of the two .wasm files; by default the one that
 * fits the browser, next to this file. */
export async function load(source) {
  if (typeof WebAssembly === "undefined") {
    throw new ProximityError(7, "this browser has no WebAssembly, which distances are computed with");
  }
  // Each address is written out, so that bundlers find both files.
  let module = source ?? (await engineBytes(hasRelaxed() ? new URL("proximity.relaxed.wasm", import.meta.url)
    : new URL("proximity.plain.wasm", import.meta.url)));
  if (!(module instanceof WebAssembly.Module)) {
    module = await WebAssembly.compile(module).catch((failure) => {
      throw new ProximityError(7, `the engine cannot be compiled here: ${failure.message}`);
    });
  }
  return new Engine(await WebAssembly.instantiate(module, {}));
}

async function engineBytes(url) {
  const advice = hasRelaxed() ? "" : "; it is for browsers without relaxed vector instructions (Node has them since "
    + "version 21, before with --experimental-wasm-relaxed-simd), and `proximity library wasm` says how it is compiled";
  if (url.protocol !== "file:" || typeof process === "undefined") return fetched(url, "WebAssembly", advice);
  return (await import("node:fs/promises")).readFile(url).catch(({ code }) => {
    const reason = code === "ENOENT" ? "there is no such file" : `it cannot be read (${code})`;
    throw new ProximityError(3, `${url.href}: ${reason}${advice}`);
  });
}

/** The bytes at an address; throws for a server's error page. */
async function fetched(url, expected, advice = "") {
  const where = String(url?.url ?? url), refuse = (reason) => {
    throw new ProximityError(3, `${where}: ${reason}${advice}`);
  };
  const answer = await fetch(url).catch((failure) => refuse(`it cannot be fetched (${failure.message})`));
  if (!answer.ok) refuse(`${answer.status} ${answer.statusText}`);
  const bytes = new Uint8Array(await answer.arrayBuffer());
  return isHtml(bytes) ? refuse(`these bytes are HTML, expected ${expected}: servers send a page for what they lack`) : bytes;
}

const isHtml = (bytes) => /^\s*<(!doctype|html|head|body)/i.test(text.decode(bytes.subarray(0, 100)));

/** The memory of one engine, and calls of its functions. Scenes of one engine share it; another thread needs another
 * engine. */
export class Engine {
  #calls; // functions by their names without "proximity_"
  #memory;
  #scratch = [0, 0, 0, 0]; // addresses of blocks used by every call
  #sizes = [0, 0, 0, 0];
  #bytes;
  #reals;
  #view;
  #error;

  constructor(instance) {
    const functions = Object.entries(instance.exports).map(([name, found]) => [name.replace("proximity_", ""), found]);
    this.#calls = Object.fromEntries(functions);
    this.#memory = instance.exports.memory;
    this.#calls._initialize();
    this.#error = this.allocate(ERROR_SIZE);
  }

  /** The version of the package, as text. */
  get version() {
    return this.textAt(this.#calls.version());
  }

  /** Open the bytes of a compiled scene, which are copied. */
  open(bytes) {
    const given = ArrayBuffer.isView(bytes) ? new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength)
      : new Uint8Array(bytes);
    if (isHtml(given)) throw new ProximityError(4, "these bytes are HTML, expected a compiled scene: a page of the server?");
    const address = this.allocate(given.byteLength);
    try {
      this.bytes.set(given, address);
      return new Scene(this, this.made("open_bytes", address, given.byteLength), address);
    } catch (failure) {
      this.free(address);
      throw failure;
    }
  }

  /** A scene without parts: add some before the first query. */
  scene() {
    return new Scene(this, this.made("new_scene"));
  }

  /** The scene of the bodies of a mesh. *vertices*: three numbers each, m; *faces*: three numbers of vertices each,
   * counter-clockwise seen from outside; without them, every three vertices are a face, as in a BufferGeometry without
   * an index. */
  fromMesh(name, vertices, faces = Int32Array.from({ length: vertices.length / 3 }, (_, k) => k)) {
    const count = rowCount(vertices, "vertices"), faceCount = rowCount(faces, "faces");
    const encoded = new TextEncoder().encode(`${name}\0`);
    const places = [this.allocate(encoded.length)];
    try {
      places.push(this.allocate(24 * count), this.allocate(12 * faceCount));
      const [words, points, rows] = places;
      this.bytes.set(encoded, words);
      this.reals.set(vertices, points / 8);
      new Int32Array(this.bytes.buffer).set(faces, rows / 4);
      return new Scene(this, this.made("from_mesh", words, points, count, rows, faceCount));
    } finally {
      places.forEach((place) => this.free(place));
    }
  }

  /** Fetch a compiled scene and open it. *url*: as `fetch` takes it. */
  async fetch(url) {
    return this.open(await fetched(url, "a compiled scene"));
  }

  // --- for scenes and trackers -------------------------------------------------------------------------

  get bytes() {
    if (this.#bytes?.buffer !== this.#memory.buffer) this.#bytes = new Uint8Array(this.#memory.buffer);
    return this.#bytes;
  }

  get reals() {
    if (this.#reals?.buffer !== this.#memory.buffer) this.#reals = new Float64Array(this.#memory.buffer);
    return this.#reals;
  }

  get view() {
    if (this.#view?.buffer !== this.#memory.buffer) this.#view = new DataView(this.#memory.buffer);
    return this.#view;
  }

  allocate(size) {
    const address = this.#calls.malloc(size + 8) >>> 0;
    if (address === 0) throw new ProximityError(2, `there is no memory for ${size} bytes`);
    return address;
  }

  free(address) {
    this.#calls.free(address);
  }

  /** The address of a block of at least a given size, kept from call to call. */
  block(number, size) {
    if (this.#sizes[number] < size) {
      if (this.#scratch[number] !== 0) this.free(this.#scratch[number]);
      this.#sizes[number] = 0;
      this.#scratch[number] = this.allocate(size);
      this.#sizes[number] = size;
    }
    return this.#scratch[number];
  }

  /** Write numbers into a block; its address. */
  written(number, numbers) {
    const address = this.block(number, 8 * numbers.length);
    this.reals.set(numbers, address / 8);
    return address;
  }

  textAt(address) {
    const { bytes } = this;
    return text.decode(bytes.slice(address, bytes.indexOf(0, address)));
  }

  call(name, ...words) {
    return this.#calls[name](...words);
  }

  /** Return the address of the object that a function makes. */
  made(name, ...words) {
    const place = this.block(2, 8);
    this.checked(name, ...words, place);
    return this.view.getUint32(place, true);
  }

  /** Call a function that returns an error code; throw its message. */
  checked(name, ...words) {
    const code = this.#calls[name](...words, this.#error);
    if (code !== 0) throw new ProximityError(code, this.textAt(this.#error + 4));
  }
}

function rowCount(numbers, name) {
  if (numbers.length % 3 !== 0) {
    throw new ProximityError(1, `${name} has ${numbers.length} numbers, expected three a row`);
  }
  return numbers.length / 3;
}

/** A scene: a compiled one, or parts that are added. */
export class Scene {
  #engine;
  #bytes; // address of the file, or 0
  #address;

  constructor(engine, address, bytes = 0) {
    this.#engine = engine;
    this.#bytes = bytes;
    this.#address = address;
    this.#readNames();
  }

  #readNames() {
    const engine = this.#engine, count = engine.call("part_count", this.#address);
    /** Names of the parts; numbers of parts in answers count along them. */
    this.parts = Array.from({ length: count }, (_, part) => engine.textAt(engine.call("part_name", this.#address, part)));
  }

  /** Add a mesh as `Engine.fromMesh` takes it, at a pose of 16 numbers; the number of its part, or of the first of its
   * bodies. */
  add(name, vertices, faces, matrix) {
    const added = this.#engine.fromMesh(name, vertices, faces);
    try {
      return this.addScene(added, matrix);
    } finally {
      added.close();
    }
  }

  /** Add copies of the parts of another scene, at a pose times their own; the number of the first. */
  addScene(added, matrix) {
    const engine = this.#engine, place = engine.block(2, 8);
    if (matrix && matrix.length !== 16) throw new ProximityError(1, `matrix has ${matrix.length} numbers, expected 16`);
    engine.checked("add_scene", this.#open, added.#open, matrix ? engine.written(0, matrix) : 0, place);
    this.#readNames();
    return engine.view.getInt32(place, true);
  }

  /** The reason for the sign method of a part from a mesh; empty for parts of a compiled scene. */
  signReason(part) {
    const address = this.#engine.call("sign_reason", this.#open, this.partNumber(part));
    return address === 0 ? "" : this.#engine.textAt(address);
  }

  /** Remove a part; the numbers of later parts decrease by one. */
  remove(part) {
    this.#engine.checked("remove", this.#open, this.partNumber(part));
    this.#readNames();
  }

  /** Free the scene's memory; it cannot be queried afterwards. */
  close() {
    if (this.#address !== 0) {
      this.#engine.call("close", this.#address);
      if (this.#bytes !== 0) this.#engine.free(this.#bytes);
    }
    this.#address = 0;
  }

  get #open() {
    if (this.#address === 0) throw new ProximityError(1, "the scene is closed");
    return this.#address;
  }

  /** The instructions in use: "relaxed" or "plain". */
  get instructions() {
    return this.#engine.textAt(this.#engine.call("instructions", this.#open));
  }

  /** Lower and upper corner of the box around all parts, hidden ones too. */
  get bounds() {
    const place = this.#engine.block(2, 48);
    this.#engine.call("bounds", this.#open, place, place + 24);
    const numbers = this.#engine.reals.slice(place / 8, place / 8 + 6);
    return { lower: numbers.slice(0, 3), upper: numbers.slice(3) };
  }

  /** The number of a part, by its name or its number. */
  partNumber(part) {
    const number = typeof part === "number" ? part : this.parts.indexOf(part);
    if (!Number.isInteger(number) || number < 0 || number >= this.parts.length) {
      throw new ProximityError(1, `there is no part ${JSON.stringify(part)}, expected one of ${this.parts.slice(0, 10).join(", ")}`);
    }
    return number;
  }

  faceCount(part) {
    return this.#engine.call("face_count", this.#open, this.partNumber(part));
  }

  isHidden(part) {
    return this.#engine.call("is_hidden", this.#open, this.partNumber(part)) !== 0;
  }

  /** The pose of a part, 16 numbers. */
  pose(part) {
    const place = this.#engine.block(2, 128);
    this.#engine.checked("pose", this.#open, this.partNumber(part), place);
    return this.#engine.reals.slice(place / 8, place / 8 + 16);
  }

  /** Move parts: *moves* is a list of {part, matrix, velocity, angularVelocity}; velocities in m/s and rad/s, at rest
   * if omitted. If one part cannot be moved, none is. */
  move(moves) {
    const engine = this.#engine, count = moves.length;
    const parts = engine.block(0, 4 * count + 8);
    moves.forEach(({ part }, k) => engine.view.setInt32(parts + 4 * k, this.partNumber(part), true));
    const numbers = new Float64Array(22 * count);
    moves.forEach(({ matrix, velocity, angularVelocity }, k) => {
      if (matrix?.length !== 16) throw new ProximityError(1, `move ${k} has no matrix of 16 numbers`);
      numbers.set(matrix, 16 * k);
      if (velocity) numbers.set(velocity, 16 * count + 3 * k);
      if (angularVelocity) numbers.set(angularVelocity, 19 * count + 3 * k);
    });
    const at = engine.written(1, numbers);
    engine.checked("move", this.#open, parts, count, at, at + 128 * count, at + 152 * count);
  }

  /** Hide a part from all queries, or show it again. */
  hide(part, isHidden = true) {
    this.#engine.checked("hide", this.#open, this.partNumber(part), isHidden ? 1 : 0);
  }

  /** Set a part's response to contact: rigid, or with *stiffness* (N/m) as a spring with a damper (N s/m). Distances
   * do not change. */
  setSurface(part, { stiffness = 0, damping = 0 } = {}) {
    this.#engine.checked("set_surface", this.#open, this.partNumber(part), stiffness, damping);
  }

  // --- queries; *ignore*: a part or a list of parts, by names or numbers, that a query leaves out ----------

  /** Address and count of the numbers of parts that a query ignores. */
  #ignored(ignore) {
    if (ignore === undefined) return NOTHING;
    const parts = (Array.isArray(ignore) ? ignore : [ignore]).map((part) => this.partNumber(part));
    const place = this.#engine.block(3, 4 * parts.length + 8), { view } = this.#engine;
    parts.forEach((part, k) => view.setInt32(place + 4 * k, part, true));
    return [place, parts.length];
  }

  /** Signed distances of points, m, negative inside. *out*: a Float64Array for them. */
  signedDistance(points, out, { ignore } = {}) {
    return this.#numbers("signed_distance_without", points, ignore, out);
  }

  /** Distances of points to the nearest surface, m. */
  distance(points, out, { ignore } = {}) {
    return this.#numbers("distance_without", points, ignore, out);
  }

  #numbers(name, points, ignore, out) {
    const engine = this.#engine, count = rowCount(points, "points");
    const rows = engine.written(0, points), answers = engine.block(1, 8 * count);
    engine.checked(name, this.#open, rows, count, ...this.#ignored(ignore), answers);
    return this.#taken(answers, count, out);
  }

  #taken(address, count, out = new Float64Array(count)) {
    const { reals } = this.#engine;
    for (let k = 0, at = address / 8; k < count; k++) out[k] = reals[at + k];
    return out;
  }

  /** Test whether points are inside a part: a Uint8Array of 0 and 1. */
  contains(points, { ignore } = {}) {
    const engine = this.#engine, count = rowCount(points, "points");
    const rows = engine.written(0, points), answers = engine.block(1, count);
    engine.checked("contains_without", this.#open, rows, count, ...this.#ignored(ignore), answers);
    return engine.bytes.slice(answers, answers + count);
  }

  /** The surface points nearest to points: arrays signedDistance, point, gradient, barycentric, part, face, feature,
   * isSigned. Beyond *maxDistance*, m, there is none. *out*: an earlier answer for the same number of points, which
   * is overwritten. */
  closest(points, { maxDistance = Infinity, out, ignore } = {}) {
    const engine = this.#engine, count = rowCount(points, "points");
    const rows = engine.written(0, points), answers = engine.block(1, CLOSEST.size * count);
    engine.checked("closest_without", this.#open, rows, count, maxDistance, ...this.#ignored(ignore), answers);
    return this.#records(CLOSEST, answers, count, out);
  }

  /** The first hits of rays: arrays distance, point, normal, barycentric, part, face. Directions have any length. */
  cast(origins, directions, { maxDistance = Infinity, ignore } = {}) {
    return this.#pairs("cast_without", HIT, origins, directions, maxDistance, ignore);
  }

  /** The distances of `cast` alone, faster. */
  castDistance(origins, directions, { maxDistance = Infinity, ignore } = {}) {
    return this.#pairs("cast_distance_without", null, origins, directions, maxDistance, ignore);
  }

  /** The shortest connections between segments and the surface: arrays distance, pointOnSegment, pointOnSolid,
   * fraction, barycentric, part, face. */
  closestToSegments(starts, ends, { maxDistance = Infinity, ignore } = {}) {
    return this.#pairs("closest_to_segments_without", SEGMENT, starts, ends, maxDistance, ignore);
  }

  #pairs(name, record, first, second, maxDistance, ignore) {
    const engine = this.#engine, count = rowCount(first, "the first array");
    if (second.length !== first.length) {
      throw new ProximityError(1, `the second array has ${second.length} numbers, expected ${first.length} as the first`);
    }
    const places = [engine.written(0, first), engine.written(2, second)];
    const answers = engine.block(1, (record?.size ?? 8) * count);
    engine.checked(name, this.#open, ...places, count, maxDistance, ...this.#ignored(ignore), answers);
    return record === null ? this.#taken(answers, count) : this.#records(record, answers, count);
  }

  #records(record, address, count, out) {
    const { reals } = this.#engine, words = new Int32Array(reals.buffer), answers = out ?? {};
    const column = (name, width, make) => {
      const found = (answers[name] ??= new make(width * count));
      if (found.length !== width * count) {
        throw new ProximityError(1, `out.${name} has ${found.length} numbers, expected ${width * count}`);
      }
      return found;
    };
    let offset = 0;
    for (const [name, width] of Object.entries(record.reals)) {
      const found = column(name, width, Float64Array);
      for (let row = 0, at = (address + offset) / 8; row < count; row++, at += record.size / 8) {
        for (let k = 0; k < width; k++) found[width * row + k] = reals[at + k];
      }
      offset += 8 * width;
    }
    for (const name of record.words) {
      const found = column(name, 1, Int32Array);
      for (let row = 0, at = (address + offset) / 4; row < count; row++, at += record.size / 4) found[row] = words[at];
      offset += 4;
    }
    return answers;
  }

  /** The shortest connection of two parts, hidden or not, if it is shorter than *maxDistance*, m: lower, distance,
   * pointOnFirst, pointOnSecond, faceOnFirst, faceOnSecond, relation. *tolerance*: the distance may be longer by
   * this share; *budget*: steps of the search, 0 for no limit. */
  clearance(first, second, { maxDistance = Infinity, tolerance = 0, budget = 0 } = {}) {
    const parts = [this.partNumber(first), this.partNumber(second)], answer = this.#engine.block(1, CLEARANCE.size);
    this.#engine.checked("clearance", this.#open, ...parts, maxDistance, tolerance, budget, answer);
    return this.#one(CLEARANCE, answer);
  }

  #one(record, address) {
    const found = this.#records(record, address, 1);
    return Object.fromEntries(Object.entries(found).map(([name, row]) => [name, row.length > 1 ? row : row[0]]));
  }

  /** The nearest pairs of visible parts, the nearest first: what `clearance` returns, with the names first and second.
   * *of*: pairs of one part, which may be hidden, and others; *most*: how many at most. */
  closestPairs({ maxDistance = Infinity, most = Infinity, of } = {}) {
    const engine = this.#engine, others = this.parts.length - 1, isOfOne = of !== undefined;
    const count = Math.min(most, isOfOne ? others : (others * (others + 1)) / 2);
    const answers = engine.block(1, CLEARANCE.size * count), parts = engine.block(0, 8 * count), to = engine.block(2, 8);
    engine.checked("closest_pairs", this.#open, isOfOne ? this.partNumber(of) : NO_PART, maxDistance, count, parts, answers,
      to);
    return Array.from({ length: engine.view.getUint32(to, true) }, (_, k) => ({
      first: this.parts[engine.view.getInt32(parts + 8 * k, true)],
      second: this.parts[engine.view.getInt32(parts + 8 * k + 4, true)],
      ...this.#one(CLEARANCE, answers + CLEARANCE.size * k),
    }));
  }

  /** How deep two parts are in each other: depth and lower bound the way out along direction, deepest and deepestLower
   * how far a point of one, deepestPoint, is inside the other. *direction*: three numbers; by default one with a short way
   * out. *tolerance*: share by which bounds may differ. */
  penetration(first, second, { direction, tolerance = 0.01 } = {}) {
    const parts = [this.partNumber(first), this.partNumber(second)], answer = this.#engine.block(1, PENETRATION.size);
    if (direction && direction.length !== 3) {
      throw new ProximityError(1, `direction has ${direction.length} numbers, expected 3`);
    }
    const along = direction ? this.#engine.written(0, direction) : 0;
    this.#engine.checked("penetration", this.#open, ...parts, along, tolerance, answer);
    return this.#one(PENETRATION, answer);
  }

  /** A tracker of *fingers* fingertips. *settings*: radius, latency, workingRange, tolerance, horizon, maxSpeed,
   * maxAcceleration, budget, as in Python's Tracker. It cannot be ticked after the scene was closed. */
  tracker(fingers, settings = {}) {
    return new Tracker(this.#engine, () => this.#open, (part) => this.partNumber(part), fingers, settings);
  }

  /** A tracker of a part, or of a list of parts that move together, among the others. *settings*: connections (1 to 16),
   * workingRange, tolerance, latency, horizon, budget, as in Python's PartTracker. It cannot be ticked after the scene
   * was closed. */
  partTracker(part, settings = {}) {
    const parts = (Array.isArray(part) ? part : [part]).map((each) => this.partNumber(each));
    return new PartTracker(this.#engine, () => this.#open, parts, settings);
  }
}

const NOTHING = [0, 0]; // addresses of omitted arguments

function instant(given) {
  if (typeof given === "bigint") return given;
  throw new ProximityError(1, "poseNs and nowNs are instants in ns, expected BigInt, such as clockNs() of the client or BigInt(Math.round(1e6 * performance.now()))");
}

const READERS = {
  Float64: (view, at) => view.getFloat64(at, true),
  BigInt64: (view, at) => view.getBigInt64(at, true),
  BigUint64: (view, at) => view.getBigUint64(at, true),
  Int32: (view, at) => view.getInt32(at, true),
  Uint32: (view, at) => view.getUint32(at, true),
  Uint16: (view, at) => view.getUint16(at, true),
  Uint8: (view, at) => view.getUint8(at),
};

const ENDED = {
  get view() {
    throw new ProximityError(1, "the tracker of this answer is closed; `copy` would have kept it");
  },
};

/** A class of records in the engine's memory, which are read field by field. */
const recordView = ({ fields }) => class View {
  static names = [];
  #engine;
  #at; // its address

  constructor(engine, address) {
    this.#engine = engine;
    this.#at = address;
  }

  static {
    for (const [name, { type, size, offset, count }] of Object.entries(fields)) {
      if (name === "reserved") continue;
      const read = READERS[type];
      const one = function () {
        return read(this.#engine.view, this.#at + offset);
      };
      const several = function () {
        const { view } = this.#engine;
        return Array.from({ length: count }, (_, k) => read(view, this.#at + offset + k * size));
      };
      Object.defineProperty(View.prototype, name, { get: count === 1 ? one : several, enumerable: true });
      View.names.push(name);
    }
  }

  /** Make records throw when read: their tracker is closed. */
  static end(records) {
    for (const record of records) record.#engine = ENDED;
  }

  /** A plain object with the present values. */
  copy() {
    return Object.fromEntries(View.names.map((name) => [name, this[name]]));
  }

  toJSON() {
    return this.copy();
  }
};

/** Answer of the last tick for one finger: fields with the names of the message, such as signed_distance, which are
 * read from the engine's memory, and change with the next tick. `copy` returns permanent ones. */
export class Contact extends recordView(RECORDS.contact) {}

/** A connection of the last tick of a part, likewise; without one, part is -1 and the distance infinite. */
export class Connection extends recordView(CONNECTION) {}

/** Contacts of every fingertip at every tick: bounds of distances, predictions, time and position of contact. */
export class Tracker {
  #engine;
  #scene; // its address, or an error if it is closed
  #partNumber;
  #address;
  #records; // address of the contacts
  #contacts;

  constructor(engine, scene, partNumber, fingers, settings) {
    this.#engine = engine;
    this.#scene = scene;
    this.#partNumber = partNumber;
    this.fingers = fingers;
    const place = engine.block(0, SETTINGS_SIZE), to = engine.block(2, 8);
    engine.call("default_settings", place);
    for (const [name, value] of Object.entries(settings)) {
      const at = SETTINGS.indexOf(name);
      if (at >= 0) engine.reals[place / 8 + at] = value;
      else if (name === "budget") engine.view.setBigInt64(place + 56, BigInt(value), true);
      else throw new ProximityError(1, `there is no setting "${name}" (expected ${SETTINGS.join(", ")}, budget)`);
    }
    engine.checked("create_tracker", scene(), fingers, place, to);
    this.#address = engine.view.getUint32(to, true);
    const { size } = RECORDS.contact;
    this.#records = engine.allocate(size * fingers);
    this.#contacts = Array.from({ length: fingers }, (_, finger) => new Contact(engine, this.#records + size * finger));
  }

  /** Compute the contacts of all fingers: *positions* has three numbers a finger, not finite if it is not tracked;
   * *poseNs*, one instant for all fingers or one for each, and *nowNs* are BigInt, ns, on one clock. Returns a list of
   * `Contact`, the same at each tick. *given*, all optional: velocities, three numbers a finger, m/s; corners, the path
   * of each fingertip as it bends, equally many corners of three numbers a finger, m, not finite for a finger without
   * one; pathBends, the bend at each corner, by default evenly from 0 to 1; bends, that of each finger at its pose. */
  tick(positions, poseNs, nowNs, given) {
    if (this.#address === 0) throw new ProximityError(1, "the tracker is closed");
    this.#scene();
    const engine = this.#engine, { fingers } = this, isOne = typeof poseNs !== "object";
    if (positions.length !== 3 * fingers || !(isOne || poseNs.length === fingers)) {
      throw new ProximityError(1, `positions have ${positions.length} numbers and there are ${isOne ? fingers : poseNs.length} instants, expected ${3 * fingers} and ${fingers}`);
    }
    const rows = engine.written(0, positions), instants = engine.block(1, 8 * fingers);
    const [velocities, paths] = given ? this.#motion(given) : NOTHING;
    const { view } = engine; // after all calls that grow the memory
    for (let k = 0; k < fingers; k++) view.setBigInt64(instants + 8 * k, instant(isOne ? poseNs : poseNs[k]), true);
    engine.checked("tick", this.#address, rows, instants, instant(nowNs), velocities, paths, this.#records);
    return this.#contacts;
  }

  /** Write optional data of fingers; return the addresses of velocities and of the record of paths, 0 for none. */
  #motion({ velocities, corners, pathBends, bends }) {
    const count = corners ? corners.length / (3 * this.fingers) : 0;
    if (corners && !(Number.isInteger(count) && count >= 2)) {
      throw new ProximityError(1, `corners have ${corners.length} numbers, expected three times two or more for each of ${this.fingers} fingers`);
    }
    const sizes = [3 * this.fingers, 3 * this.fingers * count, count, this.fingers];
    const lists = [velocities, corners, pathBends, bends];
    ["velocities", "corners", "pathBends", "bends"].forEach((name, k) => {
      if (lists[k] && lists[k].length !== sizes[k]) {
        throw new ProximityError(1, `${name} have ${lists[k].length} numbers, expected ${sizes[k]}`);
      }
    });
    let end = this.#engine.block(2, PATHS_SIZE + 8 * sizes.reduce((sum, size) => sum + size, 0));
    const paths = end, { view, reals } = this.#engine;
    end += PATHS_SIZE;
    const places = lists.map((list, k) => {
      if (!list) return 0;
      reals.set(list, end / 8);
      end += 8 * sizes[k];
      return end - 8 * sizes[k];
    });
    [places[1], count, places[2], places[3]].forEach((word, k) => view.setUint32(paths + 4 * k, word, true));
    return [places[0], corners ? paths : 0];
  }

  /** Have a finger ignore a part, such as one that the hand holds, or heed it again, from the next tick on. */
  ignore(finger, part, isIgnored = true) {
    if (this.#address === 0) throw new ProximityError(1, "the tracker is closed");
    this.#scene();
    this.#engine.checked("ignore", this.#address, finger, this.#partNumber(part), isIgnored ? 1 : 0);
  }

  /** Set the radius of one fingertip, m. */
  setRadius(finger, radius) {
    this.#engine.checked("set_radius", this.#address, finger, radius);
  }

  /** Reset all fingers: the next tick is treated as the first. */
  reset() {
    if (this.#address !== 0) this.#engine.call("reset_tracker", this.#address);
  }

  close() {
    if (this.#address !== 0) {
      this.#engine.call("destroy_tracker", this.#address);
      this.#engine.free(this.#records);
      Contact.end(this.#contacts);
    }
    this.#address = 0;
  }
}

/** The nearest connections of a part that moves to the rest of a scene, at every tick: distances with certified bounds,
 * depths, times to contact. A tick moves the part in the scene. */
export class PartTracker {
  #engine;
  #scene; // its address, or an error if it is closed
  #address;
  #records; // address of the connections
  #connections;

  constructor(engine, scene, parts, { connections = 1, ...settings }) {
    this.#engine = engine;
    this.#scene = scene;
    const rows = engine.block(1, 4 * parts.length), place = engine.block(0, 40), to = engine.block(2, 8);
    engine.call("default_part_settings", place);
    parts.forEach((part, k) => engine.view.setInt32(rows + 4 * k, part, true));
    for (const [name, value] of Object.entries(settings)) {
      const at = PART_SETTINGS.indexOf(name);
      if (at >= 0) engine.reals[place / 8 + at] = value;
      else if (name === "budget") engine.view.setBigInt64(place + 32, BigInt(value), true);
      else throw new ProximityError(1, `there is no setting "${name}" (expected connections, ${PART_SETTINGS.join(", ")}, budget)`);
    }
    engine.checked("create_part_tracker", scene(), rows, parts.length, connections, place, to);
    this.#address = engine.view.getUint32(to, true);
    this.#records = engine.allocate(CONNECTION.size * connections);
    this.#connections = Array.from({ length: connections }, (_, k) => new Connection(engine, this.#records + CONNECTION.size * k));
  }

  /** Move the part, or the first of several, and answer: a list of `Connection`, the shortest first, the same at each
   * tick. *matrix* has 16 numbers; without one the parts are where they are in the scene. Instants are BigInt, ns, on one
   * clock; velocities, m/s and rad/s, follow from the last two poses unless they are given. */
  tick(matrix, poseNs, nowNs, { velocity, angularVelocity } = {}) {
    if (this.#address === 0) throw new ProximityError(1, "the tracker is closed");
    this.#scene();
    const engine = this.#engine, lists = [matrix, velocity, angularVelocity], sizes = [16, 3, 3];
    const place = engine.block(0, 8 * 22);
    let end = place;
    const places = lists.map((list, k) => {
      if (!list) return 0;
      if (list.length !== sizes[k]) throw new ProximityError(1, `there are ${list.length} numbers, expected a matrix of 16 and velocities of 3`);
      engine.reals.set(list, end / 8);
      end += 8 * sizes[k];
      return end - 8 * sizes[k];
    });
    const [pose, linear, angular] = places;
    engine.checked("tick_part", this.#address, pose, instant(poseNs), instant(nowNs), linear, angular, this.#records);
    return this.#connections;
  }

  /** Reset: the next tick is treated as the first. */
  reset() {
    if (this.#address !== 0) this.#engine.call("reset_part_tracker", this.#address);
  }

  close() {
    if (this.#address !== 0) {
      this.#engine.call("destroy_part_tracker", this.#address);
      this.#engine.free(this.#records);
      Connection.end(this.#connections);
    }
    this.#address = 0;
  }
}
