// Commands of the step Body.
import type { Command } from "../../commands";
import type { Catalogue } from "../../protocol/messages";
import { connection } from "../../state/connection";
import { run } from "../../state/run";
import { bodyStatus, deviceFields } from "./events";
import { openedCatalogue } from "./catalogue-choices";

const isMaking = () => ["making", "waiting"].includes(bodyStatus.value?.state ?? "");

const CATALOGUES: readonly { name: Catalogue["name"]; label: string }[] = [
  { name: "material", label: "Choose the material" },
  { name: "cord", label: "Choose the cord" },
  { name: "trace", label: "Choose the trace" },
  { name: "printer", label: "Choose the printer" },
];

const hasChoice = (name: Catalogue["name"]) =>
  deviceFields.value?.choices.some(({ catalogue }) => catalogue === name) ?? false;

export const bodyCommands = (): readonly Command[] => [
  {
    id: "body.make",
    label: "Make the body",
    hint: "Run the script with these parameters, or read the file again",
    group: "Body",
    when: () => bodyStatus.value !== null && !isMaking(),
    reason: "The body is being made",
    run: () => void run(connection.send("make-body", {})),
  },
  {
    id: "body.stop",
    label: "Stop making the body",
    group: "Body",
    when: isMaking,
    reason: "The body is not being made",
    run: () => void run(connection.send("stop-body", {})),
  },
  ...CATALOGUES.map(({ name, label }) => ({
    id: `body.${name}`,
    label,
    group: "Body",
    when: () => hasChoice(name),
    reason: "The device has none",
    run: () => (openedCatalogue.value = name),
  })),
];
