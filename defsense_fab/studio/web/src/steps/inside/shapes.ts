// The simulated body's surface at rest and its shapes in all states, kept while they are valid.
import type { ArrayMessage } from "../../protocol/connection";
import { connection, device } from "../../state/connection";

/** The surface at rest. */
export interface Skin {
  revision: number;
  /** Vertices (v, 3), mm. */
  rest: Float32Array;
  faces: Uint32Array;
  edges: Uint32Array;
}

/** The body and its cords in a state. */
export interface BodyShape {
  skin: Skin;
  state: number;
  /** Vertices (v, 3), mm. */
  vertices: Float32Array;
  cords: CordShape[];
}

/** A cord in a state: its points there and at rest, mm. */
export interface CordShape {
  name: string;
  color: string;
  path: number[][];
  rest: number[][];
}

/** Largest total size of kept shapes; the oldest are dropped first. */
const MAX_KEPT_NUMBERS = 16_000_000;

let skin: Promise<Skin> | null = null;
let skinRevision = -1;
let kept = new Map<number, Promise<ArrayMessage>>();
let keptCords: unknown = null;
let keptNumbers = 0;

/** Get the shape of the body in a state of a simulation. */
export async function shapeOf(state: number, revision: number): Promise<BodyShape> {
  const cords = device.peek()?.cords;
  if (revision !== skinRevision) {
    skinRevision = revision;
    skin = connection.fetch("get-skin", {}).then(skinFrom);
    skin.catch(() => (skinRevision = -1));
    keptCords = null;
  }
  if (cords !== keptCords) {
    keptCords = cords;
    kept = new Map();
    keptNumbers = 0;
  }
  const answer = kept.get(state) ?? connection.fetch("get-shape", { state });
  if (!kept.has(state)) keep(state, answer);
  const [surface, message] = await Promise.all([skin!, answer]);
  return {
    skin: surface,
    state,
    vertices: message.arrays["vertices"] as Float32Array,
    cords: cordsFrom(message),
  };
}

function keep(state: number, answer: Promise<ArrayMessage>): void {
  const into = kept;
  into.set(state, answer);
  answer.then(
    ({ arrays }) => {
      keptNumbers += arrays["vertices"]!.length;
      if (keptNumbers > MAX_KEPT_NUMBERS && into === kept) {
        kept = new Map([[state, answer]]);
        keptNumbers = arrays["vertices"]!.length;
      }
    },
    () => into.delete(state),
  );
}

function skinFrom({ arrays, facts }: ArrayMessage): Skin {
  return {
    revision: facts["revision"],
    rest: arrays["rest"] as Float32Array,
    faces: arrays["faces"] as Uint32Array,
    edges: arrays["edges"] as Uint32Array,
  };
}

function cordsFrom({ arrays, facts }: ArrayMessage): CordShape[] {
  const points = arrays["cords"]!;
  const counts: number[] = facts["counts"];
  let at = 0;
  return (device.peek()?.cords ?? []).flatMap(({ name, color, path: rest }, k) => {
    const count = counts[k] ?? 0;
    const path = Array.from({ length: count }, (_, i) => [
      ...points.subarray(3 * (at + i), 3 * (at + i + 1)),
    ]);
    at += count;
    return count > 1 && rest.length === count ? [{ name, color, path, rest }] : [];
  });
}
