// Small pictures of poses, which the step Poses draws.
import { signal } from "@preact/signals";

/** Addresses of pictures by the name of a pose, and that of the body at rest under "". */
export const posePictures = signal<ReadonlyMap<string, string>>(new Map());
