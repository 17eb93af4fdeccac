// What the scene shares with the rest of the page.

/** What lies under the pointer. */
export interface Pick {
  kind: "cord" | "body";
  /** Name of the cord; empty for the body. */
  name: string;
  /** Place in the rest frame (3,), mm. */
  point: number[];
  /** Face of the body, or -1. */
  faceIndex: number;
}

/** A plane, as in the messages: origin (3,), and x axis, y axis and normal by rows, mm. */
export interface Frame {
  origin: number[];
  axes: number[][];
}

/** Control points and tangents of a cord, (k, 2) in its plane or (k, 3) in space, mm. */
export interface CordShape {
  frame: Frame;
  isPlanar: boolean;
  isSmooth: boolean;
  points: number[][];
  tangents: number[][];
}

export type ViewName = "front" | "back" | "left" | "right" | "top" | "bottom" | "home";
export type Projection = "perspective" | "orthographic";
