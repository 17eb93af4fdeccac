// The texts of the view.
import type { Quantity } from "./color-maps";
import type { Content, Fact } from "./content";
import type { DeviceView, Item } from "./device-view";

export const QUANTITY_LABELS: Record<Quantity, string> = {
  error: "Error without noise, mm",
  strain: "Largest principal strain, %",
};
const KIND_NAMES = { part: "part", wire: "wire", pin: "pin", seat: "marker seat" };

/** Return the name of a kind; sensors are cords or printed traces. */
export function kindName(kind: keyof typeof KIND_NAMES | "cord", noun: Content["noun"]): string {
  return kind === "cord" ? noun : KIND_NAMES[kind];
}

/** Describe the joint that is opening. */
export function describeJoint(view: DeviceView): string {
  const shares = view.shares();
  const n = shares.length;
  const opening = shares.findIndex((share) => share > 0);
  if (opening < 0) return n ? `${n} joint${n > 1 ? "s" : ""}, all closed.` : "";
  const { join, cords } = view.content.joints[opening]!;
  const sides = join.map((names) => names.join(" + ")).join(" and ");
  const noun = cords.length > 1 ? "cords" : "cord";
  const held = cords.length ? ` With ${noun} ${cords.join(", ")}.` : "";
  return `Joint ${opening + 1} of ${n} in the order of assembly: ${sides}.${held}`;
}

/** Describe a pose, its error, and where it was simulated. */
export function describePose({ content, state, surface }: DeviceView, index: number): string {
  const pose = content.poses[index]!;
  const solved = pose.at.map(percent).join(", ");
  const between =
    pose.at.length > 1 ? "interpolated smoothly between them" : "interpolated linearly from rest";
  const heldOut = pose.held_out
    ? " (of the states not designed for, the one with the largest error)"
    : "";
  const error = surface.rmse().toFixed(2);
  return (
    `${percent(state.amount)} of “${pose.name}”${heldOut}: error ${error} mm (RMSE without noise). ` +
    `Simulated at ${solved}, ${between}.`
  );
}

/** Return the title and the facts of an item. */
export function describeItem(view: DeviceView, item: Item): { title: string; facts: Fact[] } {
  const { name, facts } = item.record;
  if (item.kind === "surface") return { title: name, facts };
  const title = `${name} (${kindName(item.kind, view.content.noun)})`;
  if (item.kind !== "cord") return { title, facts };
  const cord = view.followers.indexOf(item);
  const resistance = `${Math.round(view.resistances()[cord]!)} Ω`;
  return { title, facts: [...facts, ["resistance in this view", resistance]] };
}

function percent(share: number): string {
  return `${Math.round(100 * share)}\u00a0%`;
}
