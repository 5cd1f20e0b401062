// Types of proximity.mjs, which describes each function.
import { ContactFlag, type ContactFields } from "./layout.mjs";

export { ContactFlag, type ContactFields };

export const NO_PART: -1;
export const NO_FACE: -1;
export const Relation: {
  readonly APART: 0;
  readonly TOUCHING: 1;
  readonly CROSSING: 2;
  readonly FIRST_INSIDE: 3;
  readonly SECOND_INSIDE: 4;
};
export const ConnectionFlag: {
  readonly PREDICTED: 2;
  readonly EXACT: 4;
  readonly BOUNDED: 8;
  readonly SKIPPED: 16;
  readonly INSIDE: 64;
  readonly IN_RANGE: 128;
  readonly PART_CHANGED: 256;
  readonly CROSSING: 4096;
};
export const Feature: { readonly NONE: -1; readonly FACE: 0; readonly EDGE: 1; readonly VERTEX: 2 };

export type ErrorName = "BAD_ARGUMENT" | "NO_MEMORY" | "NO_FILE" | "BAD_FILE" | "BAD_POSE" | "NO_INSIDE" | "NO_PROCESSOR" | "BROKEN" | "BAD_VERSION" | "BAD_MESH";
export const ErrorCode: Readonly<Record<ErrorName, number>>; // as in proximity.h

export class ProximityError extends Error {
  readonly code: number;
}

/** Three numbers a row. */
export type Rows = ArrayLike<number>;
export type Limit = { maxDistance?: number };
export type PartName = string | number;
/** Parts that a query leaves out. */
export type Ignoring = { ignore?: PartName | PartName[] };

export interface ClosestPoints {
  signedDistance: Float64Array;
  point: Float64Array;
  gradient: Float64Array;
  barycentric: Float64Array;
  part: Int32Array;
  face: Int32Array;
  feature: Int32Array;
  isSigned: Int32Array;
}

export interface RayHits {
  distance: Float64Array;
  point: Float64Array;
  normal: Float64Array;
  barycentric: Float64Array;
  part: Int32Array;
  face: Int32Array;
}

export interface SegmentHits {
  distance: Float64Array;
  pointOnSegment: Float64Array;
  pointOnSolid: Float64Array;
  fraction: Float64Array;
  barycentric: Float64Array;
  part: Int32Array;
  face: Int32Array;
}

export interface Clearance {
  lower: number;
  distance: number;
  pointOnFirst: Float64Array;
  pointOnSecond: Float64Array;
  faceOnFirst: number;
  faceOnSecond: number;
  relation: number;
}

/** Two parts by their names, and their clearance. */
export interface Pair extends Clearance {
  first: string;
  second: string;
}

export interface Penetration {
  depth: number;
  lower: number;
  direction: Float64Array;
  deepest: number;
  deepestLower: number;
  deepestPoint: Float64Array;
}

export interface Move {
  part: PartName;
  matrix: ArrayLike<number>;
  velocity?: ArrayLike<number>;
  angularVelocity?: ArrayLike<number>;
}

export interface TrackerSettings {
  radius?: number;
  latency?: number;
  workingRange?: number;
  tolerance?: number;
  horizon?: number;
  maxSpeed?: number;
  maxAcceleration?: number;
  budget?: number | bigint;
}

export interface PartTrackerSettings {
  connections?: number;
  workingRange?: number;
  tolerance?: number;
  latency?: number;
  horizon?: number;
  budget?: number | bigint;
}

export interface ConnectionFields {
  readonly flags: number;
  readonly work: number;
  readonly part: number;
  readonly own_part: number;
  readonly face: number;
  readonly own_face: number;
  readonly pose_ns: bigint;
  readonly age_ns: bigint;
  readonly distance: number;
  readonly lower: number;
  readonly upper: number;
  readonly point_on_own: number[];
  readonly point_on_part: number[];
  readonly normal: number[];
  readonly approach_speed: number;
  readonly predicted_ns: bigint;
  readonly predicted_distance: number;
  readonly predicted_lower: number;
  readonly predicted_upper: number;
  readonly time_to_contact: number;
  readonly time_to_contact_lower: number;
  readonly depth: number;
  readonly depth_lower: number;
}

export interface Motion {
  velocities?: Rows;
  corners?: Rows;
  pathBends?: ArrayLike<number>;
  bends?: ArrayLike<number>;
}

/** Answer of the last tick for a finger; it changes with the next one, and `copy` returns a permanent one. */
export interface Contact extends ContactFields {
  copy(): ContactFields;
  toJSON(): ContactFields;
}

/** A connection of the last tick of a part; it changes with the next one, and `copy` returns a permanent one. */
export interface Connection extends ConnectionFields {
  copy(): ConnectionFields;
  toJSON(): ConnectionFields;
}

export function hasRelaxed(): boolean;
export function load(source?: BufferSource | WebAssembly.Module): Promise<Engine>;

export class Engine {
  private constructor();
  readonly version: string;
  open(bytes: BufferSource): Scene;
  fetch(url: RequestInfo | URL): Promise<Scene>;
  scene(): Scene;
  fromMesh(name: string, vertices: Rows, faces?: ArrayLike<number>): Scene;
}

export class Scene {
  private constructor();
  readonly parts: string[];
  readonly instructions: "relaxed" | "plain";
  readonly bounds: { lower: Float64Array; upper: Float64Array };
  close(): void;
  add(name: string, vertices: Rows, faces?: ArrayLike<number>, matrix?: ArrayLike<number>): number;
  addScene(added: Scene, matrix?: ArrayLike<number>): number;
  signReason(part: PartName): string;
  remove(part: PartName): void;
  faceCount(part: PartName): number;
  isHidden(part: PartName): boolean;
  pose(part: PartName): Float64Array;
  move(moves: Move[]): void;
  hide(part: PartName, isHidden?: boolean): void;
  setSurface(part: PartName, surface?: { stiffness?: number; damping?: number }): void;
  signedDistance(points: Rows, out?: Float64Array, ignoring?: Ignoring): Float64Array;
  distance(points: Rows, out?: Float64Array, ignoring?: Ignoring): Float64Array;
  contains(points: Rows, ignoring?: Ignoring): Uint8Array;
  closest(points: Rows, limit?: Limit & Ignoring & { out?: ClosestPoints }): ClosestPoints;
  cast(origins: Rows, directions: Rows, limit?: Limit & Ignoring): RayHits;
  castDistance(origins: Rows, directions: Rows, limit?: Limit & Ignoring): Float64Array;
  closestToSegments(starts: Rows, ends: Rows, limit?: Limit & Ignoring): SegmentHits;
  clearance(first: PartName, second: PartName, limits?: Limit & { tolerance?: number; budget?: number }): Clearance;
  closestPairs(limits?: Limit & { most?: number; of?: PartName }): Pair[];
  penetration(first: PartName, second: PartName, given?: { direction?: Rows; tolerance?: number }): Penetration;
  tracker(fingers: number, settings?: TrackerSettings): Tracker;
  partTracker(part: PartName | PartName[], settings?: PartTrackerSettings): PartTracker;
}

export class Tracker {
  private constructor();
  readonly fingers: number;
  tick(positions: Rows, poseNs: bigint | ArrayLike<bigint>, nowNs: bigint, given?: Motion): Contact[];
  ignore(finger: number, part: PartName, isIgnored?: boolean): void;
  setRadius(finger: number, radius: number): void;
  reset(): void;
  close(): void;
}

export class PartTracker {
  private constructor();
  tick(matrix: Rows | undefined | null, poseNs: bigint, nowNs: bigint, given?: { velocity?: Rows; angularVelocity?: Rows }): Connection[];
  reset(): void;
  close(): void;
}
