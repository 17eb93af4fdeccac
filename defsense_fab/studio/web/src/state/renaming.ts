// Which item of the tree has its name edited.
import { signal } from "@preact/signals";

/** Identifier of a node of the tree, such as "cord:left"; null for none. */
export const renaming = signal<string | null>(null);
