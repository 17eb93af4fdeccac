// The panels of each step; a step's folder registers its own.
import { signal } from "@preact/signals";
import type { ComponentType } from "preact";
import type { Viewer } from "../scene/viewer";
import type { Command } from "../commands";
import { STEPS, type StepName } from "../state/step";

export interface StepPanels {
  /** Inspector of the selection, at the right; below the scene on a phone. */
  inspector: ComponentType;
  /** Tools that float at the top of the scene. */
  toolbar?: ComponentType;
  /** Legend that floats at the lower left of the scene. */
  legend?: ComponentType;
  /** Panel below the scene, and its title. */
  bottom?: ComponentType;
  bottomTitle?: string;
  /** Show the step's things in the scene; return a function that removes them. */
  scene?: (viewer: Viewer) => () => void;
  /** Commands of the step; their keys work while it is entered. */
  commands?: () => readonly Command[];
  /** Shown in place of the scene, at its full size. */
  stage?: ComponentType;
}

const registered = signal<ReadonlyMap<StepName, StepPanels>>(new Map());

export function registerStep(name: StepName, panels: StepPanels): void {
  registered.value = new Map(registered.value).set(name, panels);
}

export function stepPanels(name: StepName): StepPanels | undefined {
  return registered.value.get(name);
}

/** The commands of all steps. */
export function stepCommands(): Command[] {
  return STEPS.flatMap((step) =>
    (stepPanels(step)?.commands?.() ?? []).map((command) => ({ ...command, step })),
  );
}
