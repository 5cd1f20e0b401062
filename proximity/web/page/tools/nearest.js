// The moving part and its nearest parts: connections, numbers, and the limit of its motion before contact.

import * as THREE from "three";
import { mm } from "../frames.js";
import { Label } from "../labels.js";
import { rowsOf } from "../local_scene.js";

const MOST = 3; // connections, at most one a part
const APART = 0, TOUCHING = 1; // relations, see proximity.mjs
const TOLERANCE = 0.01; // of the displayed distance
const STEP_TOLERANCE = 0.2; // of the displacement of the part
const MAX_STEPS = 40;
const GAP = 1e-5; // m, minimum distance of an approaching part
const NEARER = 0.999;
const MEETING = 0xa00000;

export class Nearest {
  /** *most*: number of connections; *tolerance*: share of a distance; *reach*: m, the largest distance, by default the
   * radius of the scene; *names*: of the parts to connect to, by default all. */
  constructor(stage, parts, local, { most = MOST, tolerance = TOLERANCE, reach, names } = {}) {
    Object.assign(this, { stage, parts, local, most, tolerance, reach, names });
    this.found = []; // displayed connections: part, distance, lower, relation, ends
    this.group = new THREE.Group();
    const material = new THREE.LineBasicMaterial({ color: 0xffffff, depthTest: false });
    this.lines = new THREE.LineSegments(new THREE.BufferGeometry(), material);
    this.lines.renderOrder = 18;
    this.labels = Array.from({ length: most }, () => new Label({ height: 0.08, avoids: true }));
    this.group.add(this.lines, ...this.labels.map((label) => label.object));
    this.group.visible = false;
    stage.root.add(this.group);
  }

  clear() {
    this.shown = null;
    this.found = [];
    if (!this.group.visible) return;
    this.group.visible = false;
    for (const each of this.parts.list) for (const mesh of each.meshes) mesh.material.color.set(each.colour);
  }

  /** Update the nearest connections of a part after a move; return a sentence, or null. */
  show(part) {
    if (!this.local.scene || !part.object.visible) return null;
    const key = `${this.local.version}|${part.name}`;
    if (key === this.shown) return null;
    this.shown = key;
    this.local.follow(this.local.scene, this.parts.list);
    this.found = [];
    let maxDistance = this.reach ?? this.stage.radius;
    for (const other of this.others(part)) {
      const answer = this.local.scene.clearance(part.name, other.name, { maxDistance, tolerance: this.tolerance });
      if (answer.distance > maxDistance) continue;
      this.found.push({ part: other, ...answer });
      this.found.sort((one, two) => one.distance - two.distance);
      const meeting = this.found.filter(({ relation }) => relation !== APART).length;
      this.found.length = Math.min(this.found.length, Math.max(this.most, meeting));
      if (this.found.length >= this.most) maxDistance = this.found.at(-1).distance;
    }
    this.draw(part);
    const words = this.found.map(({ part: other, ...answer }) => `${other.name} ${said(answer)}`);
    return `${part.name}: ${words.join(", ") || "nothing is near"}.`;
  }

  others(part) {
    return this.parts.list.filter((other) => other !== part && other.object.visible && (this.names?.includes(other.name) ?? true));
  }

  draw(part) {
    const apart = this.found.filter(({ relation }) => relation === APART).slice(0, this.most);
    const ends = apart.flatMap(({ pointOnFirst, pointOnSecond }) => [...pointOnFirst, ...pointOnSecond]);
    this.lines.geometry.dispose();
    this.lines.geometry = new THREE.BufferGeometry();
    this.lines.geometry.setAttribute("position", new THREE.Float32BufferAttribute(ends, 3));
    this.labels.forEach((label, k) => {
      label.object.visible = k < apart.length;
      if (!label.object.visible) return;
      label.show(said(apart[k]));
      label.setHeight(0.08 * this.stage.radius);
      label.object.position.fromArray(ends, 6 * k).add(new THREE.Vector3().fromArray(ends, 6 * k + 3)).multiplyScalar(0.5);
      label.anchor(0.5, -0.25);
    });
    const meeting = new Set(this.found.filter(({ relation }) => relation > TOUCHING).map((each) => each.part));
    for (const each of this.parts.list) for (const mesh of each.meshes) mesh.material.color.set(meeting.has(each) ? MEETING : each.colour);
    this.group.visible = true;
  }

  /** The displacement of a part on its way to *matrix* before contact: certified for the whole motion. A part that
   * already meets another moves to its target. */
  reached(part, matrix) {
    if (!this.local.scene) return matrix;
    this.local.follow(this.local.scene, this.parts.list);
    const from = poseOf(part.object.matrix), to = poseOf(matrix);
    const length = from.place.distanceTo(to.place) + from.turn.angleTo(to.turn) * this.reachOf(part);
    if (length === 0 || this.free(part, Infinity) === 0) return matrix;
    let share = 0, before = 0;
    for (let step = 0; step < MAX_STEPS && share < 1; step++) {
      const lower = this.free(part, 2 * (1 - share) * length);
      if (lower < GAP && lower < NEARER * before) break;
      before = lower;
      share = Math.min(share + lower / 2 / length, 1);
      this.put(part, between(from, to, share));
    }
    this.put(part, part.object.matrix);
    return share < 1 ? between(from, to, share) : matrix;
  }

  /** The maximum distance of a part's points from its origin. */
  reachOf(part) {
    if (part.reach === undefined) {
      const { min, max } = this.parts.bounds([part], part.object);
      part.reach = min.negate().max(max).length();
    }
    return part.reach;
  }

  put(part, matrix) {
    this.local.scene.move([{ part: part.name, matrix: rowsOf(matrix) }]);
  }

  /** A lower bound of the distance to other parts at their present poses; at most *limit*. */
  free(part, limit) {
    let lower = limit;
    for (const other of this.others(part)) {
      lower = Math.min(lower, this.local.scene.clearance(part.name, other.name, { maxDistance: lower, tolerance: STEP_TOLERANCE }).lower);
    }
    return lower;
  }
}

function said({ distance, lower, relation }) {
  if (relation !== APART) return ["", "touches", "crosses", "is around it", "is inside it"][relation];
  const bounds = mm(lower) === mm(distance) ? "" : `${mm(lower)} to `;
  return `${bounds}${mm(distance)} mm`;
}

function poseOf(matrix) {
  const pose = { place: new THREE.Vector3(), turn: new THREE.Quaternion() };
  matrix.decompose(pose.place, pose.turn, new THREE.Vector3());
  return pose;
}

function between(from, to, share) {
  const one = new THREE.Vector3(1, 1, 1);
  return new THREE.Matrix4().compose(from.place.clone().lerp(to.place, share), from.turn.clone().slerp(to.turn, share), one);
}
