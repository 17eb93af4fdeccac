// What is outside the newest body: a message with the way out, and labels at the places.
import { effect, signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { useCommands } from "../commands";
import type { MisfitState } from "../protocol/messages";
import { type Label } from "../scene/label-layer";
import { viewer } from "../scene/stage";
import { bodyFit, connection } from "../state/connection";
import { run } from "../state/run";
import { select } from "../state/selection";
import { type StepName, step } from "../state/step";
import { Button, IconButton } from "../ui/button";
import { Icon } from "../ui/icons";

/** Steps whose scene is the body at rest, with what labels show there; Sensors labels its cords. */
const LABELED: Partial<Record<StepName, readonly MisfitState["kind"][]>> = {
  body: ["cord", "region", "pose"],
  poses: ["cord", "region", "pose"],
  sensors: ["region", "pose"],
};

const SHORT: Record<MisfitState["kind"], string> = {
  cord: "does not fit the body",
  region: "not in its place",
  pose: "pulls outside the body",
};

const closedText = signal("");

const isFitting = signal(false);
const EFFECT = "Move them as the body has changed, and keep the limits of cords; undo reverts it";

async function fit(): Promise<void> {
  isFitting.value = true;
  await run(connection.send("fit-to-body", {}));
  isFitting.value = false;
}

function labels(): Label[] {
  const kinds = LABELED[step.value] ?? [];
  return (bodyFit.value?.misfits ?? [])
    .filter(({ kind, at }) => kinds.includes(kind) && at.length === 3)
    .map(({ kind, name, at }) => ({
      id: `misfit-${kind}-${name}`,
      text: `${name}: ${SHORT[kind]}`,
      at,
      tone: "alarm",
      priority: 9,
      onClick: () => select({ kind, name }),
    }));
}

export function BodyFitNotice() {
  useCommands(() => [
    {
      id: "body.fit",
      label: "Fit cords and regions to the body",
      hint: EFFECT,
      group: "Body",
      when: () => bodyFit.value?.canFit ?? false,
      run: () => void fit(),
    },
  ]);
  useEffect(() => effect(() => viewer.value?.labels.set("misfits", labels())), []);
  const { text = "", canFit = false } = bodyFit.value ?? {};
  if (!text) closedText.value = "";
  if (!text || text === closedText.value || !LABELED[step.value]) return null;
  return (
    <div class="body-fit" role="alert">
      <Icon name="warning" />
      <p>{text}</p>
      {canFit && (
        <Button hint={EFFECT} isBusy={isFitting.value} onClick={() => void fit()}>
          Fit them to the body
        </Button>
      )}
      <IconButton icon="close" label="Leave them there" onClick={() => (closedText.value = text)} />
    </div>
  );
}
