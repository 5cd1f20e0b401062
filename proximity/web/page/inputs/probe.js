// The probe: a point at the mouse, on a part or off it, and its nearest surface point.

import * as THREE from "three";
import { Finger } from "../fingers.js";
import { mm } from "../frames.js";
import { byId, setText } from "../panel.js";

const SIZE = 0.018; // of the probe, of the parts' size
const STEP = 0.005; // of the wheel, of the parts' size
const ON = 5e-9; // m: nearer is on the surface

export class Probe {
  constructor(stage, parts, local) {
    Object.assign(this, { stage, parts, local });
    this.joints = null; // it has no hand
    this.pointer = new THREE.Vector2(); // the middle of the view, until the mouse moves
    this.last = null; // last hit of the pointer on a part, scene frame
    this.lift = 0; // m off the surface
    this.answer = null;
    this.caster = new THREE.Raycaster();
    byId("probe-lift").oninput = ({ target }) => (this.lift = Number(target.value) / 1e3 || 0);
  }

  hint = "Point at a part, or beside it. Shift and the wheel move the probe off the surface.";

  start() {
    if (this.listening) return;
    this.mark ??= new Mark(this.stage);
    this.listening = new AbortController();
    const { signal } = this.listening, { canvas } = this.stage;
    canvas.addEventListener("pointermove", (event) => event.buttons || this.point(event), { signal });
    canvas.addEventListener("pointerdown", (event) => this.point(event), { signal, capture: true });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { signal, passive: false, capture: true });
  }

  stop() {
    this.listening?.abort();
    this.listening = this.answer = null;
    byId("probe-card").hidden = true;
    if (this.mark) this.mark.group.visible = false;
  }

  point({ clientX, clientY }) {
    this.pointer.set((2 * clientX) / innerWidth - 1, 1 - (2 * clientY) / innerHeight);
  }

  wheel(event) {
    if (!event.shiftKey) return; // the view is zoomed
    event.preventDefault();
    event.stopImmediatePropagation();
    this.lift -= Math.sign(event.deltaY || event.deltaX) * STEP * this.stage.radius;
    byId("probe-lift").value = +(1e3 * this.lift).toFixed(3);
  }

  /** Query at the pointer; called before each picture. *isBusy*: the pointer holds a part. */
  update(isBusy) {
    const { scene } = this.local;
    if (isBusy && this.mark) this.mark.group.visible = false;
    if (isBusy || !this.listening || !scene || !this.parts.isLoaded) return;
    this.local.follow(scene, this.parts.list);
    const row = this.points.under(this.pointer), isOfScan = row >= 0;
    const position = isOfScan ? [...this.points.coordinates.subarray(3 * row, 3 * row + 3)] : this.placed(scene).toArray(), found = scene.closest(position);
    const distance = !isOfScan && Math.abs(found.signedDistance[0]) < ON ? 0 : found.signedDistance[0];
    this.answer = {
      isKnown: found.part[0] >= 0, isExact: true, isSigned: found.isSigned[0] !== 0, distance,
      part: this.parts.list[found.part[0]]?.name, position, pointOnFinger: position, pointOnPart: [...found.point],
      normal: [...found.gradient], point: isOfScan ? `#${row}` : "",
    };
    this.mark.show(this.answer, this.stage);
    this.say(this.answer);
  }

  /** The point under the pointer, scene frame: on a part, its cut or the slice, or at the distance of the last of them. */
  placed(scene) {
    const { camera, root, controls } = this.stage;
    this.isBeside = false;
    this.caster.setFromCamera(this.pointer, camera);
    const { ray } = this.caster, toScene = root.matrixWorld.clone().invert();
    let begin = 0, end = Infinity;
    for (const plane of this.parts.clipping) {
      const at = ray.distanceToPlane(plane) ?? Infinity;
      if (plane.distanceToPoint(ray.origin) < 0) begin = at;
      else end = at;
    }
    const slice = this.plane.mesh.visible ? this.caster.intersectObject(this.plane.mesh)[0] : undefined;
    const onSlice = slice?.point.clone().applyMatrix4(toScene);
    if (slice && slice.distance <= begin) return (this.last = onSlice);
    end = Math.min(end, slice?.distance ?? Infinity);
    if (begin < Infinity) {
      const own = ray.clone().applyMatrix4(toScene), origin = own.at(begin, new THREE.Vector3());
      if (begin > 0 && scene.contains(origin.toArray())[0]) return (this.last = origin);
      const hit = scene.cast(origin.toArray(), own.direction.toArray(), { maxDistance: end - begin });
      if (hit.part[0] >= 0) {
        const normal = new THREE.Vector3(...hit.normal);
        this.last = new THREE.Vector3(...hit.point);
        const side = normal.dot(own.direction) > 0 ? -1 : 1; // towards the eye
        return this.last.clone().addScaledVector(normal, side * this.lift);
      }
    }
    if (slice) return (this.last = onSlice);
    this.isBeside = true;
    const middle = this.last ? this.stage.toWorld(this.last) : controls.target;
    const facing = new THREE.Plane().setFromNormalAndCoplanarPoint(camera.getWorldDirection(new THREE.Vector3()), middle);
    return (ray.intersectPlane(facing, new THREE.Vector3()) ?? controls.target.clone()).applyMatrix4(toScene);
  }

  say(answer) {
    byId("probe-card").hidden = false;
    setText(byId("probe-distance"), words(answer, 3));
    setText(byId("probe-side"), answer.point ? `${answer.point} of ${this.points.name}, ${sideOf(answer)}` : sideOf(answer));
    setText(byId("probe-depth"), !answer.point && this.isBeside ? "Beside the parts: as far from the eye as the last point on a part." : "");
    setText(byId("probe-at"), lengths(answer.position, 3));
    setText(byId("probe-near"), lengths(answer.pointOnPart, 3));
    setText(byId("probe-normal"), lengths(answer.normal.map((each) => each / 1e3), 3)); // of length 1, not in mm
  }
}

/** The drawn probe: a fingertip without a size, also within parts. */
class Mark extends Finger {
  constructor(stage) {
    super(1, stage.root);
    for (const each of [this.ball, this.rod, this.disc]) {
      each.material.depthTest = false;
      each.renderOrder = 18;
    }
  }

  show(answer, stage) {
    this.radius = SIZE * stage.radius;
    const eye = stage.toScene(stage.camera.position).distanceTo(new THREE.Vector3(...answer.position));
    const text = answer.point ? `${words(answer, 3)}\n${answer.point}` : answer.distance === 0 ? `on ${answer.part}\n${lengths(answer.position)}` : words(answer);
    super.show({ ...answer, text: answer.isKnown ? text : "no part" }, "OK", null, () => 0.019 * eye);
    this.ball.visible = !answer.point; // the point itself is visible
  }
}

const lengths = (numbers, digits = 2) => numbers.map((each) => mm(each, digits)).join("   ");
const words = ({ isSigned, distance }, digits = 2) => `${isSigned ? "" : "± "}${mm(distance, digits)} mm`;

function sideOf({ isKnown, isSigned, distance, part }) {
  if (!isKnown) return "no part is shown";
  if (distance === 0) return `on ${part}`;
  return isSigned ? `${distance < 0 ? "inside" : "from"} ${part}` : `from ${part}; inside or outside is not known`;
}
