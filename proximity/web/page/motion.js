// A motion of one part: slider and playback, the shortest connection, and the curve of the distance with its bounds.

import * as THREE from "three";
import { mm } from "./frames.js";
import { byId, isTyped, setText } from "./panel.js";
import { Nearest } from "./tools/nearest.js";

const PLAY_MS = 6000; // from the first position to the last
const POSES_IN_VIEW = 24;
const [LEFT, RIGHT, TOP, BOTTOM] = [8, 632, 18, 92]; // of the curve, in the units of its drawing
const RELATIONS = ["", "touches", "crosses", "is inside", "is around"]; // see proximity.mjs
const SVG = "http://www.w3.org/2000/svg";

export class Motion {
  /** *about*: the motion of the welcome; lengths in metres, positions as in Python. */
  constructor(stage, parts, local, about) {
    Object.assign(this, { stage, parts, local, about });
    this.part = parts.named(about.part);
    this.first = about.positions[0];
    this.last = about.positions.at(-1);
    this.worst = about.first_touch?.[1] ?? about.position;
    this.isPlaying = false;
    this.nearest = new Nearest(stage, parts, local, { most: 1, tolerance: 0, reach: Infinity, names: about.others });
    this.showAll();
    this.drawCurve();
    byId("motion").hidden = false;
    byId("motion-play").onclick = () => this.setPlaying(!this.isPlaying);
    byId("motion-worst").onclick = () => this.stopAt(this.worst);
    byId("motion-at").oninput = (event) => this.stopAt(this.at(Number(event.target.value)));
    const curve = byId("motion-curve");
    curve.onpointerdown = curve.onpointermove = (event) => event.buttons && this.stopAt(this.at(this.shareUnder(event)));
    addEventListener("keydown", (event) => {
      if (event.code !== "Space" || isTyped(event) || event.target.closest?.("button, summary")) return;
      event.preventDefault();
      this.setPlaying(!this.isPlaying);
    });
    addEventListener("resize", () => this.lift());
    stage.updates.add(() => this.update());
    this.lift();
    this.goTo(this.first);
  }

  at(share) {
    return this.first + Math.min(Math.max(share, 0), 1) * (this.last - this.first);
  }

  share(position) {
    return (position - this.first) / (this.last - this.first);
  }

  /** Scene from part, at a position. */
  matrixAt(position) {
    const isIn = ({ start, end }) => (position - start) * (position - end) <= 0;
    const { start, end, pose, centre, shift, axis, angle } = this.about.spans.find(isIn);
    const share = (position - start) / (end - start), point = new THREE.Vector3(...centre);
    const matrix = new THREE.Matrix4().set(...pose).premultiply(new THREE.Matrix4().makeTranslation(point.clone().negate()));
    matrix.premultiply(new THREE.Matrix4().makeRotationAxis(new THREE.Vector3(...axis), share * angle));
    return matrix.premultiply(new THREE.Matrix4().makeTranslation(point.addScaledVector(new THREE.Vector3(...shift), share)));
  }

  /** Set the view to all parts during the whole motion. */
  showAll() {
    const box = new THREE.Box3();
    for (let k = 0; k <= POSES_IN_VIEW; k++) {
      this.place(this.at(k / POSES_IN_VIEW));
      box.union(this.parts.bounds(k ? [this.part] : undefined));
    }
    this.stage.setBounds(box);
  }

  /** Show the parts above the card of the motion. */
  lift() {
    const { innerWidth: width, innerHeight: height } = window;
    this.stage.camera.setViewOffset(width, height, 0, byId("motion").offsetHeight / 2, width, height);
    this.stage.wake();
  }

  place(position) {
    const { object } = this.part;
    this.matrix = this.matrixAt(position);
    object.matrix.copy(this.matrix);
    object.matrixWorldNeedsUpdate = true;
  }

  goTo(position) {
    this.position = position;
    this.place(position);
    this.parts.changed();
    byId("motion-at").value = this.share(position);
    this.cursor.setAttribute("transform", `translate(${this.x(position)} 0)`);
    this.stage.wake();
  }

  stopAt(position) {
    this.setPlaying(false);
    this.goTo(position);
  }

  setPlaying(isPlaying) {
    if (isPlaying && this.position === this.last) this.goTo(this.first);
    this.isPlaying = isPlaying;
    this.lastMs = performance.now();
    byId("motion-play").textContent = isPlaying ? "Pause" : "Play";
    byId("motion-play").setAttribute("aria-pressed", isPlaying);
    this.stage.wake();
  }

  /** Called before each picture. */
  update() {
    if (this.isPlaying) {
      const now = performance.now(), share = this.share(this.position) + (now - this.lastMs) / PLAY_MS;
      this.lastMs = now;
      this.goTo(share < 1 ? this.at(share) : this.last);
      if (share >= 1) this.setPlaying(false);
    }
    const { object, name } = this.part;
    if (object.visible) this.nearest.show(this.part);
    else this.nearest.clear();
    const [found] = this.nearest.found;
    const now = found ? (RELATIONS[found.relation] || `${mm(found.distance, 3)} mm to`) + ` ${found.part.name}` : "no visible parts to measure";
    const isMoved = !object.matrix.equals(this.matrix); // by another tool
    setText(byId("motion-text"), isMoved ? `${name} has left its motion; the slider moves it back.` : `${this.named(this.position)}: ${now}`);
  }

  /** A position in words. */
  named(position) {
    const { unit, scale } = this.about, value = position / scale;
    const text = unit === "degrees" ? `${value.toFixed(1)}°` : unit === "mm" ? `${value.toFixed(2)} mm` : `position ${+value.toPrecision(6)}`;
    return text.replace("-", "−");
  }

  // --- the curve ---

  x(position) {
    return LEFT + this.share(position) * (RIGHT - LEFT);
  }

  y(distance) {
    return BOTTOM - (distance / this.highest) * (BOTTOM - TOP);
  }

  shareUnder(event) {
    const { left, width } = byId("motion-curve").getBoundingClientRect();
    return ((event.clientX - left) / width * 640 - LEFT) / (RIGHT - LEFT);
  }

  drawCurve() {
    const { positions, distances, bounds, distance, lower, nearest, first_touch: touch } = this.about;
    this.highest = Math.max(...distances) || 1;
    const curve = byId("motion-curve"), point = (k, value = distances[k]) => `${this.x(positions[k]).toFixed(2)},${this.y(value).toFixed(2)}`;
    const area = bounds.map((bound, k) => `M${point(k)}L${point(k + 1)}L${point(k + 1, bound)}L${point(k, bound)}Z`).join("");
    add(curve, "path", { class: "area", d: area });
    add(curve, "path", { class: "floor", d: `M${LEFT},${BOTTOM}H${RIGHT}` });
    add(curve, "polyline", { class: "line", points: positions.map((_, k) => point(k)).join(" ") });
    if (touch) add(curve, "path", { class: "touch", d: `M${this.x(touch[1])},${TOP}V${BOTTOM}` });
    this.cursor = add(curve, "path", { class: "cursor", d: `M0,${TOP - 4}V${BOTTOM + 4}` });
    add(curve, "circle", { class: "worst", cx: this.x(this.worst), cy: this.y(distance), r: 5 });
    const label = (x, y, text, anchor) => (add(curve, "text", { x, y, "text-anchor": anchor }).textContent = text);
    label(LEFT, 11, `${mm(this.highest, 2)} mm`, "start");
    label(LEFT, 108, this.named(this.first), "start");
    label(RIGHT, 108, this.named(this.last), "end");
    const least = mm(lower, 3) === mm(distance, 3) ? "" : `${mm(lower, 3)} to `;
    const words = touch ? "first touch at" : `smallest distance ${least}${mm(distance, 3)} mm, to ${nearest}, at`;
    setText(byId("motion-least"), `${words} ${this.named(this.worst)}`);
    setText(byId("motion-worst"), touch ? "First touch" : "Smallest");
  }
}

function add(parent, name, attributes) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return parent.appendChild(element);
}
