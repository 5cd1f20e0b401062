// Tools beyond viewing: move, measure, clip, slice, reset, picture, link.

import * as THREE from "three";
import { byId, isTyped, offer } from "../panel.js";
import { Clashes } from "./clashes.js";
import { Measure } from "./measuring.js";
import { Nearest } from "./nearest.js";
import { PointCloud } from "./points.js";
import { SlicePlane } from "./slice_plane.js";

const STEP = 0.001;
const TURN = THREE.MathUtils.degToRad(5);
const HINTS = {
  move: "Drag a part, or select one in the list and use the arrow keys. Q and E turn it.",
  measure: "Click two points on the surface, or two parts in the list.",
};
const KEYS = { KeyM: "move", KeyD: "measure", KeyC: "clip", KeyS: "slice", KeyP: "picture", KeyL: "link", Home: "reset", Slash: "help" };

export class Tools {
  constructor(stage, parts, local, panel, probe) {
    Object.assign(this, { stage, parts, local, panel, probe });
    this.mode = "";
    this.caster = new THREE.Raycaster();
    this.measure = new Measure(stage);
    this.nearest = new Nearest(stage, parts, local);
    this.plane = probe.plane = new SlicePlane(stage, parts, local);
    this.clashes = new Clashes(stage, parts);
    this.points = probe.points = new PointCloud(stage, parts, local, panel);
    parts.limited = (part, matrix) => (byId("tool-stop").checked ? this.nearest.reached(part, matrix) : matrix);
    this.mayMove = false;
    this.actions = {
      move: () => this.setMode(this.mode === "move" ? "" : "move"),
      measure: () => this.setMode(this.mode === "measure" ? "" : "measure"),
      clip: () => this.setPlane("clips"),
      slice: () => this.setPlane("slices"),
      reset: () => this.reset(),
      points: () => byId("points-file").click(),
      picture: () => this.picture(),
      link: () => this.copyLink(),
      help: () => this.toggleHelp(),
    };
    for (const [name, act] of Object.entries(this.actions)) byId(`tool-${name}`).onclick = act;
    const canvas = stage.canvas;
    canvas.addEventListener("pointerdown", (event) => this.down(event), { capture: true });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("hashchange", () => this.readLink());
  }

  say(text) {
    byId("tool-hint").textContent = text;
  }

  /** Report the nearest parts of the picked part. */
  update() {
    const part = this.mode === "measure" ? null : this.parts.picked;
    const words = part ? this.nearest.show(part) : this.nearest.clear();
    if (words) this.say(words);
  }

  setMode(mode) {
    if (mode === "move" && !this.mayMove) return this.say("This page only shows: parts are moved by another program.");
    this.mode = mode;
    for (const name of ["move", "measure"]) byId(`tool-${name}`).setAttribute("aria-pressed", name === mode);
    this.stage.canvas.style.cursor = mode === "move" ? "grab" : mode === "measure" ? "crosshair" : "";
    if (mode !== "measure") this.measure.clear();
    this.say(HINTS[mode] ?? "");
  }

  /** A part was chosen in the list: it is measured, or picked. */
  async choosePart(part) {
    if (this.mode !== "measure") return this.parts.pick(part === this.parts.picked ? null : part);
    const names = this.measure.addPart(part.name);
    if (!names) return this.say(`${part.name} and …: choose the second part in the list.`);
    this.say(this.measure.showParts(names, await this.local.clearance(names, this.parts.list)));
  }

  /** Clip or slice, or neither: "clips" or "slices". */
  setPlane(what, isOn = !this.plane[what]) {
    this.plane[what] = isOn;
    byId("tool-clip").setAttribute("aria-pressed", this.plane.clips);
    byId("tool-slice").setAttribute("aria-pressed", this.plane.slices);
    this.plane.update();
  }

  reset() {
    this.setMode("");
    this.clashes.choose(null);
    if (this.mayMove) this.parts.reset();
    this.closePlane();
    this.stage.home();
  }

  async picture() {
    const name = `${document.title.split(" ")[0]}.png`;
    const { mark } = this.probe, wasSeen = mark?.group.visible;
    if (mark) mark.group.visible = false;
    const picture = this.stage.picture((context) => this.points.drawBar(context));
    if (mark) mark.group.visible = wasSeen;
    offer(await picture, name);
    this.say(`The picture is saved as ${name}.`);
  }

  /** A URL of this page with this view; it contains the token, so it is private. */
  async copyLink() {
    const round = (vector) => vector.toArray().map((x) => +x.toPrecision(6));
    const view = {
      eye: round(this.stage.camera.position),
      at: round(this.stage.controls.target),
      hidden: this.parts.list.filter((part) => !part.object.visible).map((part) => part.name),
      plane: this.plane.state(),
    };
    const hash = new URLSearchParams(location.hash.slice(1));
    hash.set("view", JSON.stringify(view));
    history.replaceState(null, "", `#${hash}`);
    const copied = await navigator.clipboard?.writeText(location.href).then(() => true, () => false);
    this.say(`The link to this view is ${copied ? "copied" : "in the address bar"}; it works while this page is served.`);
  }

  /** Restore the view of the URL, if it has one. */
  readLink() {
    const text = new URLSearchParams(location.hash.slice(1)).get("view");
    if (!text) return;
    try {
      const view = JSON.parse(text);
      this.stage.camera.position.fromArray(view.eye);
      this.stage.controls.target.fromArray(view.at);
      for (const part of this.parts.list) this.parts.setVisible(part, !view.hidden.includes(part.name));
      this.plane.restore(view.plane);
      for (const what of ["clips", "slices"]) this.setPlane(what, view.plane[what]);
      this.stage.controls.update();
      this.parts.changed();
    } catch {
      this.panel.say("The view in this address cannot be used.");
    }
  }

  /** Close open items: the keys, then the clash, then the tool and the picked part, then the plane. */
  escape() {
    if (!byId("help").hidden) return this.toggleHelp();
    if (this.clashes.chosen) return this.clashes.choose(null);
    if (this.mode || this.parts.picked) return void (this.setMode(""), this.parts.pick(null));
    this.closePlane();
  }

  closePlane() {
    for (const what of ["clips", "slices"]) this.setPlane(what, false);
  }

  toggleHelp() {
    byId("help").hidden = !byId("help").hidden;
    byId("tool-help").setAttribute("aria-expanded", !byId("help").hidden);
    byId("help").scrollIntoView();
  }

  aim(event) {
    const pointer = new THREE.Vector2((2 * event.clientX) / innerWidth - 1, 1 - (2 * event.clientY) / innerHeight);
    this.caster.setFromCamera(pointer, this.stage.camera);
    return this.parts.under(this.caster);
  }

  down(event) {
    this.pressed = [event.clientX, event.clientY];
    if (this.mode !== "move" || event.button !== 0) return;
    const hit = this.aim(event);
    if (!hit) return;
    event.stopImmediatePropagation(); // the view stays
    this.stage.canvas.setPointerCapture(event.pointerId);
    this.parts.pick(hit.part);
    const normal = this.stage.camera.getWorldDirection(new THREE.Vector3()).negate();
    this.held = {
      part: hit.part,
      plane: new THREE.Plane().setFromNormalAndCoplanarPoint(normal, hit.point),
      from: this.stage.toScene(hit.point),
      matrix: hit.part.object.matrix.clone(),
    };
  }

  drag(event) {
    if (!this.held) return;
    this.aim(event);
    const point = this.caster.ray.intersectPlane(this.held.plane, new THREE.Vector3());
    if (!point) return;
    const shift = this.stage.toScene(point).sub(this.held.from);
    this.parts.ask(this.held.part, new THREE.Matrix4().makeTranslation(shift).multiply(this.held.matrix));
  }

  up(event) {
    if (this.held) {
      this.held = null;
      this.plane.changed();
      return;
    }
    const moved = this.pressed ? Math.hypot(event.clientX - this.pressed[0], event.clientY - this.pressed[1]) : 9;
    if (this.mode !== "measure" || moved > 4) return;
    const hit = this.aim(event);
    if (hit) this.say(this.measure.add(this.stage.toScene(hit.point)));
  }

  key(event) {
    if (event.code === "Escape") return this.escape();
    if (isTyped(event)) return;
    if (event.key === "+" || event.key === "=") return this.stage.zoom(0.9);
    if (event.key === "-") return this.stage.zoom(1 / 0.9);
    if (event.key.startsWith("Arrow") || event.code === "KeyQ" || event.code === "KeyE") return this.nudge(event);
    const action = KEYS[event.code];
    if (!action || (event.code === "Slash" && event.key !== "?")) return;
    event.preventDefault();
    this.actions[action]();
  }

  /** Move or turn the picked part by the keyboard; without one arrow keys turn the view. */
  nudge(event) {
    const part = this.parts.picked;
    const turn = { KeyQ: TURN, KeyE: -TURN }[event.code];
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (!part || !this.mayMove) {
      if (way) this.turnView(...way);
      return;
    }
    event.preventDefault();
    const matrix = (this.parts.wanted.get(part.name) ?? part.object.matrix).clone(); // it may not be there yet
    if (turn) {
      const place = new THREE.Vector3().setFromMatrixPosition(matrix);
      const about = new THREE.Matrix4().makeTranslation(place).multiply(new THREE.Matrix4().makeRotationZ(turn));
      matrix.premultiply(about.multiply(new THREE.Matrix4().makeTranslation(place.negate())));
    } else {
      const length = STEP * (event.shiftKey ? 10 : 1);
      matrix.premultiply(new THREE.Matrix4().makeTranslation(way[0] * length, way[1] * length, 0));
    }
    this.parts.ask(part, matrix);
    this.plane.changed();
  }

  turnView(across, along) {
    const { camera, controls } = this.stage;
    const from = camera.position.clone().sub(controls.target);
    const place = new THREE.Spherical().setFromVector3(from);
    place.theta -= 0.08 * across;
    place.phi = Math.min(Math.max(place.phi - 0.06 * along, 0.05), Math.PI - 0.05);
    camera.position.copy(controls.target).add(from.setFromSpherical(place));
  }
}
