// Parts in this page's engine: slices of the signed distance, and measurements between two parts.

import { hasRelaxed, load } from "./proximity.mjs";

const MAX_AT_ONCE = 3000; // points of a slice, before hands are updated
const SAME = 1e-12;

export class LocalScene {
  /** *ask* returns page contents by name. */
  constructor(ask) {
    this.ask = ask;
    this.scene = null; // once it is open
    this.version = 0; // of the displayed parts: incremented when they are moved, hidden or shown
    this.followed = -1;
  }

  /** The scene, opened at its first use. */
  open() {
    return (this.opened ??= this.read());
  }

  async read() {
    const engine = await window.saved?.(`proximity.${hasRelaxed() ? "relaxed" : "plain"}.wasm`);
    return (this.scene = (await load(engine)).open(filled(await this.ask("scene"))));
  }

  /** Move and hide parts as displayed: a service may have moved them. */
  follow(scene, parts) {
    if (this.followed === this.version) return;
    this.followed = this.version;
    const moves = [];
    parts.forEach(({ object }, part) => {
      const matrix = rowsOf(object.matrix), pose = scene.pose(part);
      if (matrix.some((number, k) => Math.abs(number - pose[k]) > SAME)) moves.push({ part, matrix });
      if (scene.isHidden(part) === object.visible) scene.hide(part, !object.visible);
    });
    if (moves.length) scene.move(moves);
  }

  /** The signed distance on a plane, row by row; null if it is no longer wanted. */
  async sliced({ origin, u, v, width, height }, parts, isWanted) {
    const scene = await this.open();
    this.follow(scene, parts);
    const values = new Float64Array(width * height);
    const rows = Math.max(Math.floor(MAX_AT_ONCE / width), 1);
    for (let row = 0; row < height; row += rows) {
      if (!isWanted()) return null;
      const points = new Float64Array(3 * width * Math.min(rows, height - row));
      for (let k = 0; k < points.length; k++) {
        const at = Math.floor(k / 3), axis = k % 3;
        const across = row + Math.floor(at / width), along = at % width;
        points[k] = origin[axis] + (across / (height - 1)) * v[axis] + (along / (width - 1)) * u[axis];
      }
      values.set(scene.signedDistance(points), row * width);
      await new Promise((next) => setTimeout(next));
    }
    return values;
  }

  /** The clearance of two parts, by their names. */
  async clearance(names, parts) {
    const scene = await this.open();
    this.follow(scene, parts);
    return scene.clearance(...names);
  }
}

/** Fill in the omitted data of a compiled scene: coordinates of triangles, which are those of the parts' corners. */
function filled(bytes) {
  const size = new DataView(bytes).getUint32(24, true);
  const { layout, arrays } = documentOf(bytes.slice(64, 64 + size));
  const at = Object.fromEntries(arrays.map(({ name, offset, shape }) => [name, [bytes, 64 + size + offset, shape.reduce((a, b) => a * b)]]));
  const reals = new Float64Array(...at.reals), words = new Int32Array(...at.words), rows = new BigInt64Array(...at.parts);
  for (let row = 0; row < rows.length - layout.PART_COLUMNS; row += layout.PART_COLUMNS) {
    const of = (field) => Number(rows[row + layout[`PART_${field}`]]);
    const first = layout.LANES * of("FIRST_BLOCK"), count = layout.LANES * of("BLOCK_COUNT");
    const [slotFaces, faces, corners] = ["SLOT_FACES", "FACES", "CORNERS"].map(of);
    for (let slot = first; slot < first + count; slot++) {
      const face = words[slotFaces + slot];
      const to = Math.floor(slot / layout.LANES) * layout.BLOCK_STRIDE + (slot % layout.LANES);
      for (let k = 0; k < 9; k++) {
        const corner = face < 0 ? 0 : words[faces + 3 * face + Math.floor(k / 3)];
        reals[to + layout.LANES * k] = face < 0 ? NaN : reals[corners + 3 * corner + (k % 3)];
      }
    }
  }
  return bytes;
}

export const documentOf = (bytes) => JSON.parse(new TextDecoder().decode(bytes));
export const rowsOf = (matrix) => matrix.clone().transpose().toArray();
