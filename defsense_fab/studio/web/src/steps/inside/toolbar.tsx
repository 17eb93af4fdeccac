// The tools on the scene: the plane, the view, and the search for another cord.
import type { Command } from "../../commands";
import { isPhone } from "../../state/layout";
import { IconButton } from "../../ui/button";
import { SegmentedControl } from "../../ui/choices";
import { flipPlane, isFacing, setAxis, showNextState, tool, view } from "./inside-state";
import { NextCordActions, NextCordToggle } from "./next-cord-tools";
import { AXES, axisOf } from "./plane";
import { inside } from "./section-view";

const isReady = () => inside.value?.isReady ?? false;

export const insideCommands = (): readonly Command[] =>
  commandList().map((command) => ({
    ...command,
    when: isReady,
    reason: "Simulate the poses first",
  }));

const commandList = (): readonly Command[] => [
  {
    id: "inside.face",
    label: "Face the section",
    hint: "Look at the section along its normal, or return",
    group: "Inside",
    shortcut: "L",
    run: () => (isFacing.value = !isFacing.value),
  },
  {
    id: "inside.next-state",
    label: "Next state",
    hint: "Show the section in the next state",
    group: "Inside",
    shortcut: "S",
    run: showNextState,
  },
  {
    id: "inside.flip",
    label: "Turn the plane over",
    hint: "Show the other half of the body",
    group: "Inside",
    shortcut: "R",
    run: flipPlane,
  },
  ...AXES.map((axis) => ({
    id: `inside.axis-${axis}`,
    label: `Section normal to ${axis}`,
    group: "Inside",
    shortcut: axis.toUpperCase(),
    run: () => setAxis(axis),
  })),
  {
    id: "inside.next-cord",
    label: "Show where a cord would help",
    group: "Inside",
    shortcut: "W",
    run: () => tool.turn(!tool.isOn.peek()),
  },
];

/** The tools of the plane and of the search. */
export function InsideToolbar() {
  const plane = view.plane.value;
  if (!plane) return null;
  return (
    <div class="inside-tools">
      <SegmentedControl
        label="Normal of the plane"
        value={axisOf(plane) ?? "other"}
        segments={AXES.map((axis) => ({
          value: axis,
          label: axis.toUpperCase(),
          hint: `Cut through the middle, normal to ${axis}`,
        }))}
        onChange={(axis) => axis !== "other" && setAxis(axis)}
      />
      <IconButton
        icon="mirror"
        label="Turn the plane over"
        hint="Show the other half of the body"
        shortcut="R"
        onClick={flipPlane}
      />
      <IconButton
        icon="eye"
        label="Face the section"
        hint="Look at the section along its normal"
        shortcut="L"
        isPressed={isFacing.value}
        onClick={() => (isFacing.value = !isFacing.value)}
      />
      <span class="tool-line" aria-hidden="true" />
      <NextCordToggle tool={tool} />
      {!isPhone.value && <NextCordActions tool={tool} view={view} />}
    </div>
  );
}
