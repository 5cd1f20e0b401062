// Answers queries of a scene from standard input by the module for browsers:
// node module_server.mjs FOLDER SET SCENE.prox. A query is a number, the row count, a limit, and the rows; see
// bench/benchmarks/digest/library_program.py. Rows of eight bytes change the scene, and tick a tracker on it; see
// bench/benchmarks/digest/module_tracker.py.
import { readFileSync, readSync, writeSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [folder, set, file] = process.argv.slice(2);
const { load, ProximityError } = await import(pathToFileURL(`${folder}/proximity.mjs`).href);
const { encode } = await import(pathToFileURL(`${folder}/proximity_client.mjs`).href);
const { RECORDS } = await import(pathToFileURL(`${folder}/layout.mjs`).href);
const engine = await load(readFileSync(`${folder}/proximity.${set}.wasm`));
let scene = engine.open(readFileSync(file)), tracker = null, settings = {};

function taken(size) {
  const bytes = new Uint8Array(size);
  for (let at = 0; at < size; ) {
    let count = 0;
    try {
      count = readSync(0, bytes, at, size - at, null);
    } catch (failure) {
      if (failure.code !== "EAGAIN") throw failure;
      continue;
    }
    if (count === 0) return null;
    at += count;
  }
  return bytes;
}

function told(bytes) {
  for (let at = 0; at < bytes.length; ) {
    try {
      at += writeSync(1, bytes, at, bytes.length - at);
    } catch (failure) {
      if (failure.code !== "EAGAIN") throw failure;
    }
  }
}

/** Pack columns into the row records that C writes. */
function records(count, reals, words) {
  const size = 8 * reals.reduce((sum, [, width]) => sum + width, 0) + 4 * words.length;
  const bytes = new ArrayBuffer(size * count), view = new DataView(bytes);
  for (let row = 0, at = 0; row < count; row++) {
    for (const [column, width] of reals) {
      for (let k = 0; k < width; k++, at += 8) view.setFloat64(at, column[width * row + k], true);
    }
    for (const column of words) {
      view.setInt32(at, column[row], true);
      at += 4;
    }
  }
  return new Uint8Array(bytes);
}

const bytesOf = (array) => new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
const QUESTIONS = [
  (n, p, _, limit) => {
    const a = scene.closest(p, limit);
    const reals = [[a.signedDistance, 1], [a.point, 3], [a.gradient, 3], [a.barycentric, 3]];
    return records(n, reals, [a.part, a.face, a.feature, a.isSigned]);
  },
  (n, p) => bytesOf(scene.signedDistance(p)),
  (n, p) => bytesOf(scene.distance(p)),
  (n, p) => scene.contains(p),
  (n, p, q, limit) => {
    const a = scene.cast(p, q, limit);
    return records(n, [[a.distance, 1], [a.point, 3], [a.normal, 3], [a.barycentric, 3]], [a.part, a.face]);
  },
  (n, p, q, limit) => bytesOf(scene.castDistance(p, q, limit)),
  (n, p, q, limit) => {
    const a = scene.closestToSegments(p, q, limit);
    const reals = [[a.distance, 1], [a.pointOnSegment, 3], [a.pointOnSolid, 3], [a.fraction, 1], [a.barycentric, 3]];
    return records(n, reals, [a.part, a.face]);
  },
];
const SIZES = [96, 8, 8, 1, 88, 8, 96];

const SETTINGS = ["latency", "workingRange", "tolerance", "horizon", "maxSpeed", "maxAcceleration", "budget"];
function begin() {
  tracker = scene.tracker(settings.radii.length, settings.given);
  settings.radii.forEach((radius, finger) => tracker.setRadius(finger, radius));
}
const ACTIONS = {
  20: (rows) => { // settings, then a radius per finger
    const known = SETTINGS.map((name, k) => [name, rows[k]]).filter(([, value]) => Number.isFinite(value));
    settings = { given: Object.fromEntries(known), radii: Array.from(rows.slice(SETTINGS.length)) };
    begin();
  },
  21: (rows) => { // the scene was replaced
    tracker.close();
    scene.close();
    scene = engine.open(readFileSync(file));
    begin();
  },
  22: (rows) => { // 23 numbers per part
    scene.move(Array.from({ length: rows.length / 23 }, (_, k) => {
      const row = rows.slice(23 * k, 23 * k + 23);
      return { part: row[0], matrix: row.slice(1, 17), velocity: row.slice(17, 20), angularVelocity: row.slice(20) };
    }));
  },
  23: ([part, isHidden]) => scene.hide(part, isHidden !== 0),
  24: () => tracker.reset(),
  25: (rows, words) => { // times, positions, then optional columns given by the first four words
    const count = settings.radii.length, now = words[0], sizes = [count, 3 * count, ...[1, 2, 3, 4].map((k) => rows[k])];
    let at = 5;
    const [, positions, ...more] = sizes.map((size) => rows.slice(at, (at += size)));
    const [velocities, corners, pathBends, bends] = more.map((list) => (list.length ? list : null));
    const known = { velocities, corners, pathBends, bends };
    const contacts = tracker.tick(positions, Array.from(words.slice(5, 5 + count)), now, known);
    return encode("frame", {}, contacts.map((each) => each.copy())).slice(RECORDS.frame_header.size);
  },
};

function act(question, count) {
  const bytes = taken(8 * count).buffer;
  const answer = ACTIONS[question](new Float64Array(bytes), new BigInt64Array(bytes));
  told(new Uint8Array(8));
  if (answer) told(answer);
}

for (let head = taken(24); head !== null; head = taken(24)) {
  const view = new DataView(head.buffer);
  const question = Number(view.getBigInt64(0, true)), count = Number(view.getBigInt64(8, true));
  if (question >= 20) {
    act(question, count);
    continue;
  }
  const limit = { maxDistance: view.getFloat64(16, true) };
  const first = new Float64Array(taken(24 * count).buffer);
  const second = question >= 4 ? new Float64Array(taken(24 * count).buffer) : null;
  let code = 0, answers = new Uint8Array(SIZES[question] * count);
  try {
    answers = QUESTIONS[question](count, first, second, limit);
  } catch (failure) {
    if (!(failure instanceof ProximityError)) throw failure;
    code = failure.code;
  }
  told(new Uint8Array(new BigInt64Array([BigInt(code)]).buffer));
  told(answers);
}
scene.close();
