// The data of a report's 3D view, as scene.py writes them.
import type { PackedNumbers } from "./packed-arrays";

/** A label and a value. */
export type Fact = [label: string, value: string];
export type Vector = [x: number, y: number, z: number];
export type FollowerKind = "cord" | "wire" | "pin" | "seat";

export interface PartRecord {
  name: string;
  color: string;
  facts: Fact[];
  /** Index of its vertices. */
  places: number;
  /** Index of its triangles. */
  faces: number;
}

/** A cord, wire, pin or marker seat, which moves along with parts. */
export interface FollowerRecord {
  kind: FollowerKind;
  name: string;
  color: string | null;
  facts: Fact[];
  /** Radius of a tube, mm; 0 for the four corners of a seat. */
  radius: number;
  /** Index of its points at rest. */
  places: number;
  /** Index of its displacements when each joint opens. */
  opened: number;
  /** Index of its displacements in each state. */
  moved: number;
}

export interface JointRecord {
  /** Names of the parts on both sides. */
  join: [string[], string[]];
  /** Names of the cords that the joint holds. */
  cords: string[];
  /** Displacement of each part when the joint opens, mm. */
  ways: Vector[];
}

/** Indices of the surface's arrays, and the ends of the color scales. */
export interface SurfaceRecord {
  places: number;
  faces: number;
  moved: number;
  missed: number;
  missed_step: number;
  strain: number;
  top_error: number;
  top_strain: number;
}

export interface PoseRecord {
  name: string;
  held_out: boolean;
  /** Simulated states on the path from rest, and where they are on it, up to 1. */
  states: number[];
  at: number[];
}

export interface Content {
  device: string;
  noun: "cord" | "trace";
  /** Unit of packed lengths, mm. */
  step: number;
  /** Diagonal of the device, mm. */
  size: number;
  /** Axes to the right, up and towards the viewer. */
  frame: [Vector, Vector, Vector];
  parts: PartRecord[];
  joints: JointRecord[];
  followers: FollowerRecord[];
  surface: SurfaceRecord;
  states: { name: string; signals: number[] }[];
  poses: PoseRecord[];
  /** Resistance of each cord at rest, ohm. */
  resistances: number[];
}

/** The data with their arrays. */
export interface Contents {
  content: Content;
  arrays: PackedNumbers[];
}
