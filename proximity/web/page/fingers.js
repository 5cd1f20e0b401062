// Fingertips: sphere, line to the nearest point, number, predicted contact, path.

import * as THREE from "three";
import { GREY, distanceColour, mix } from "./colours.js";
import { mm, shownDistance } from "./frames.js";
import { Label } from "./labels.js";

const BALL = new THREE.SphereGeometry(1, 24, 16);
const ROD = new THREE.CylinderGeometry(1, 1, 1, 8).translate(0, 0.5, 0).rotateX(Math.PI / 2); // along z, 0 to 1
const DISC = new THREE.RingGeometry(0.45, 1, 28);
const FAR = 0.15; // m: longer lines are not drawn
const SOON_MS = 250;

export class Fingers {
  constructor(stage) {
    this.stage = stage;
    this.group = new THREE.Group();
    stage.root.add(this.group);
    this.shown = [];
  }

  setRadii(radii) {
    for (const finger of this.shown) this.group.remove(finger.group);
    this.shown = radii.map((radius) => new Finger(radius, this.group));
  }

  /** Show a reading; *paths* are those that the page has sent, by finger. */
  show(reading, paths) {
    // On a screen all numbers have one size; in a headset they are objects with perspective.
    const eye = this.stage.toScene(this.stage.camera.position);
    const isWorn = this.stage.renderer.xr.isPresenting;
    const heightAt = (at) => (isWorn ? 0.009 : 0.019 * eye.distanceTo(new THREE.Vector3(...at)));
    reading.contacts.forEach((contact) => {
      if (!this.shown[contact.finger]) return;
      this.shown[contact.finger].show(contact, reading.state, paths.get(contact.finger), heightAt);
    });
    if (!reading.contacts.length) for (const finger of this.shown) finger.group.visible = false;
  }
}

export class Finger {
  constructor(radius, parent) {
    this.radius = radius;
    this.group = new THREE.Group();
    this.group.visible = false;
    parent.add(this.group);
    const skin = new THREE.MeshStandardMaterial({ roughness: 0.45, transparent: true });
    const flat = () => new THREE.MeshBasicMaterial({ transparent: true, toneMapped: false });
    this.ball = new THREE.Mesh(BALL, skin);
    this.rod = new THREE.Mesh(ROD, flat());
    this.disc = new THREE.Mesh(DISC, flat());
    this.disc.material.side = THREE.DoubleSide;
    this.ghost = new THREE.Mesh(BALL, flat());
    this.ghost.material.depthWrite = false;
    this.path = new THREE.Line(
      new THREE.BufferGeometry(),
      new THREE.LineBasicMaterial({ color: 0xd7dee8, transparent: true, opacity: 0.35 }),
    );
    this.path.frustumCulled = false;
    this.label = new Label({ height: 0.008, avoids: true });
    this.group.add(this.ball, this.rod, this.disc, this.ghost, this.path, this.label.object);
    this.colour = new THREE.Color();
    this.last = null;
  }

  show(contact, state, path, heightAt) {
    const isStale = state === "STALE" || state === "STOPPING";
    // A lost hand remains, grey and without a number, at its last position.
    if (contact.isKnown) this.last = contact.position;
    const at = contact.isKnown ? contact.position : isStale ? this.last : null;
    if (!isStale && !contact.isKnown) this.last = null;
    this.group.visible = at !== null && at.every(Number.isFinite);
    if (!this.group.visible) return;
    const opacity = state === "LATE" ? 0.4 : isStale ? 0.5 : 1;
    const paint = isStale ? GREY : state === "LATE" ? mix(GREY, distanceColour(contact.distance), 0.5) : distanceColour(contact.distance);
    this.colour.setRGB(...paint, THREE.SRGBColorSpace);
    this.ball.position.set(...at);
    this.ball.scale.setScalar(this.radius);
    this.ball.material.color.copy(this.colour);
    this.ball.material.emissive.copy(this.colour).multiplyScalar(isStale ? 0 : 0.28);
    this.ball.material.opacity = opacity;
    this.showConnection(contact, opacity, isStale);
    this.showTouch(contact, path, isStale);
    this.showLabel(contact, at, state, opacity, heightAt(at));
    this.showPath(isStale ? null : path, opacity);
  }

  showConnection(contact, opacity, isStale) {
    const isShown = !isStale && contact.pointOnPart.every(Number.isFinite) && (Math.abs(contact.distance) < FAR || contact.text !== undefined);
    this.rod.visible = this.disc.visible = isShown;
    if (!isShown) return;
    const from = new THREE.Vector3(...contact.pointOnFinger);
    const to = new THREE.Vector3(...contact.pointOnPart);
    const thick = Math.max(0.05 * this.radius, 0.0002);
    this.rod.position.copy(from);
    this.rod.scale.set(thick, thick, Math.max(from.distanceTo(to), 1e-6));
    towards(this.rod, to.clone().sub(from));
    this.rod.material.color.copy(this.colour);
    this.rod.material.opacity = opacity;
    this.disc.position.copy(to).addScaledVector(new THREE.Vector3(...contact.normal), 0.02 * this.radius);
    this.disc.scale.setScalar(0.32 * this.radius);
    towards(this.disc, new THREE.Vector3(...contact.normal));
    this.disc.material.color.copy(this.colour);
    this.disc.material.opacity = opacity;
  }

  /** The predicted contact: on its path, or straight ahead. */
  showTouch(contact, path, isStale) {
    const isSoon = !isStale && contact.isKnown && contact.contactMs > 0 && contact.contactMs < SOON_MS;
    let place = null;
    if (path && Number.isFinite(contact.contactBend) && !contact.isTouching) place = alongPath(path, contact.contactBend);
    else if (isSoon) place = contact.position.map((x, k) => x + (contact.velocity[k] * contact.contactMs) / 1e3);
    this.ghost.visible = !isStale && contact.isKnown && place !== null && place.every(Number.isFinite);
    if (!this.ghost.visible) return;
    this.ghost.position.set(...place);
    this.ghost.scale.setScalar(this.radius);
    this.ghost.material.color.setHex(0xffe7ad);
    this.ghost.material.opacity = isSoon ? 0.34 : 0.14;
  }

  showLabel(contact, at, state, opacity, lineHeight) {
    let text = "?";
    if (contact.isKnown) {
      text = contact.text ?? shownDistance(contact);
      if (!contact.isExact && !contact.isBound) text += `\n${mm(contact.lower, 1)} … ${mm(contact.upper, 1)}`;
      if (contact.contactMs > 0 && contact.contactMs < SOON_MS) text += `\nin ${Math.round(contact.contactMs)} ms`;
    }
    this.label.show(text, contact.isTouching ? "#ff9d8a" : "#f4f6f9", Math.max(opacity, 0.75));
    this.label.object.position.set(...at);
    this.label.setHeight(lineHeight);
    this.label.anchor(-0.12 - this.radius / this.label.object.scale.x, 0.5);
  }

  showPath(path, opacity) {
    this.path.visible = Boolean(path);
    if (!path) return;
    const kept = this.path.geometry.getAttribute("position");
    if (kept && kept.count * 3 === path.length) {
      kept.array.set(path);
      kept.needsUpdate = true;
    } else this.path.geometry.setAttribute("position", new THREE.Float32BufferAttribute(path, 3));
    this.path.material.opacity = 0.35 * opacity;
  }
}

function alongPath(path, bend) {
  const count = path.length / 3 - 1;
  const place = Math.min(Math.max(bend, 0), 1) * count;
  const k = Math.min(Math.floor(place), count - 1);
  return [0, 1, 2].map((i) => path[3 * k + i] + (path[3 * k + 3 + i] - path[3 * k + i]) * (place - k));
}

const Z = new THREE.Vector3(0, 0, 1);
function towards(object, direction) {
  if (direction.lengthSq() > 0) object.quaternion.setFromUnitVectors(Z, direction.normalize());
}
