import type { ComponentType } from "preact";
import { useEffect } from "preact/hooks";
import { connection } from "../../state/connection";
import { isPhone, sheet } from "../../state/layout";
import { run } from "../../state/run";
import { CheckCard } from "./check-card";
import { LiveCard } from "./live-card";
import { LiveWindow } from "./live-window";
import "./measure.css";
import { RecordCard } from "./record-card";
import { SpecimenCard } from "./specimen-card";
import { type CardName, card, isGuidedOpen, isLiveShown } from "./state";
import { TrainCard } from "./train-card";

const PANELS: Record<CardName, ComponentType> = {
  check: CheckCard,
  record: RecordCard,
  train: TrainCard,
  live: LiveCard,
  specimen: SpecimenCard,
};

/** The chosen card, in place of the scene. */
export function MeasureStage() {
  useEffect(() => void run(connection.send("refresh-choices", {})), []);
  useEffect(() => {
    if (isGuidedOpen.value && isPhone.value) sheet.value = "closed"; // room for the instruction
  }, [isGuidedOpen.value]);
  const Card = PANELS[card.value];
  return (
    <div class="measure-stage">
      <Card key={card.value} />
      {isLiveShown.value && <LiveWindow />}
    </div>
  );
}
