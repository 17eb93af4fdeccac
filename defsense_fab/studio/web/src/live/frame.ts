// A frame of the live device, as it comes with its arrays.
import type { ArrayMessage, NumberArray } from "../protocol/connection";
import type { FrameFacts } from "../protocol/messages";

export interface Frame {
  facts: FrameFacts;
  /** Signals (R - R0)/R0 of the channels (c,); NaN of failed ones. */
  signals: NumberArray;
  /** Positions (m, 3) of the markers, mm, and radii (m,) of their intervals. */
  markers: NumberArray;
  radius: NumberArray;
  /** Surface vertices (v, 3), mm; null if only markers are known. */
  vertices: NumberArray | null;
  /** Those of the simulated device (v, 3), mm; null for a real one. */
  trueVertices: NumberArray | null;
  /** Points (p, 3) of all cords, mm, in a row; null without a surface. */
  cords: NumberArray | null;
  /** Markers as cameras see them (n, 3), mm; null without cameras. */
  tracks: NumberArray | null;
}

export function readFrame({ arrays, facts }: ArrayMessage): Frame {
  return {
    facts: facts as FrameFacts,
    signals: arrays.signals!,
    markers: arrays.markers!,
    radius: arrays.radius!,
    vertices: arrays.vertices ?? null,
    trueVertices: arrays.trueVertices ?? null,
    cords: arrays.cords ?? null,
    tracks: arrays.tracks ?? null,
  };
}
