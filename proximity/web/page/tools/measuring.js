// Distance of two points of the surface, or of two parts.

import * as THREE from "three";
import { mm } from "../frames.js";
import { Label } from "../labels.js";

const RELATIONS = ["are apart", "touch", "cross", "overlap: the first is inside", "overlap: the second is inside"];

export class Measure {
  constructor(stage) {
    this.stage = stage;
    this.names = []; // of parts to measure
    this.group = new THREE.Group();
    this.points = [];
    stage.root.add(this.group);
  }

  clear() {
    this.points = [];
    this.names = [];
    this.group.clear();
  }

  /** Add a part; return the names of both when there are two. */
  addPart(name) {
    if (this.points.length || this.names.length === 2) this.clear();
    if (!this.names.includes(name)) this.names.push(name);
    return this.names.length === 2 ? this.names : null;
  }

  /** Show the measured distance of two parts; return a sentence. */
  showParts(names, { distance, pointOnFirst, pointOnSecond, relation }) {
    this.clear();
    if (distance === 0) return `${names[0]} and ${names[1]} ${RELATIONS[relation]}.`;
    this.add(new THREE.Vector3(...pointOnFirst));
    return `${names[0]} and ${names[1]}: ${this.add(new THREE.Vector3(...pointOnSecond))}`;
  }

  /** Add a point, scene frame; return a sentence. */
  add(point) {
    if (this.points.length === 2) this.clear();
    this.names = [];
    this.points.push(point);
    const ball = new THREE.Mesh(
      new THREE.SphereGeometry(0.012 * this.stage.radius, 16, 12),
      new THREE.MeshBasicMaterial({ color: 0xffffff, depthTest: false, toneMapped: false }),
    );
    ball.renderOrder = 18;
    ball.position.copy(point);
    this.group.add(ball);
    if (this.points.length < 2) return "Click the second point.";
    const [from, to] = this.points;
    const geometry = new THREE.BufferGeometry().setFromPoints([from, to]);
    const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: 0xffffff, depthTest: false }));
    line.renderOrder = 18;
    const label = new Label({ height: 0.07 * this.stage.radius, avoids: true });
    const apart = to.clone().sub(from);
    const parts = apart.toArray().map((x) => mm(x, 2));
    label.show(`${mm(apart.length(), 2)} mm\n${parts.join("  ")}`);
    label.object.position.copy(from).add(to).multiplyScalar(0.5);
    label.anchor(0.5, -0.25);
    this.group.add(line, label.object);
    return `${mm(apart.length(), 2)} mm apart; along x, y, z: ${parts.join(", ")} mm.`;
  }
}
