// New names of cords, poses and regions.
import { Refusal } from "../protocol/connection";
import { connection } from "../state/connection";
import { type Item, followRename } from "../state/selection";

/** Poses are also names of files, in which the format allows no spaces. */
export const underscored = (text: string): string => text.replace(/\s/g, "_");
export const UNDERSCORE_NOTE = "Spaces become _ in names of poses";

const REQUESTS = {
  cord: (cord: string, name: string) => connection.send("rename-cord", { cord, name }),
  pose: (pose: string, name: string) => connection.send("rename-pose", { pose, name }),
  region: (region: string, name: string) => connection.send("rename-region", { region, name }),
};

type Renamable = keyof typeof REQUESTS;

/** Rename an item; a refusal is thrown. */
export async function rename(kind: Renamable, name: string, to: string): Promise<void> {
  await REQUESTS[kind](name, to);
  const item: Item = { kind, name };
  followRename(item, to);
}

/** Rename an item; return why it is refused, or null. */
export async function renameOrReason(kind: Renamable, name: string, to: string): Promise<string | null> {
  try {
    await rename(kind, name, to);
    return null;
  } catch (error) {
    return error instanceof Refusal ? error.problem.message : String(error);
  }
}
