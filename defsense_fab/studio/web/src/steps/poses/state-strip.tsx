// The states below the scene: rest, each pose with its picture, and a slider from rest to the pose.
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { UNDERSCORE_NOTE, renameOrReason, underscored } from "../../shell/rename";
import { device } from "../../state/connection";
import { posePictures } from "../../state/pose-pictures";
import { clearSelection, isSelected, select } from "../../state/selection";
import { IconButton } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { openContextMenuFor } from "../../ui/menu";
import { tooltip } from "../../ui/tooltip";
import { NameInput } from "../../ui/name-input";
import { poseMenu } from "./commands";
import { isLoading, isPlaying, playRamp, ramp, setShare, share } from "./ramp";
import { isMeshed, isSolving, picturesState, posesState, shownPose, shownState, simulatedStates } from "./state";
import { poseProblem } from "./warnings";

const CARD_GAP_PX = 8;

export function StateStrip() {
  const poses = posesState.value?.poses ?? [];
  return (
    <div class="state-strip">
      <div class="pose-cards" role="group" aria-label="States">
        <PoseCard name="" label="Rest" isChosen={!shownPose.value && !shownState.value} onChoose={clearSelection} />
        {poses.map((pose) => (
          <PoseCard
            key={pose.name}
            name={pose.name}
            label={pose.name}
            problem={poseProblem(pose)?.text}
            isChosen={shownPose.value?.name === pose.name && !shownState.value}
            onChoose={(isAdded) => {
              shownState.value = "";
              select({ kind: "pose", name: pose.name }, isAdded);
            }}
            onMenu={(event) => {
              if (!isSelected({ kind: "pose", name: pose.name })) select({ kind: "pose", name: pose.name });
              openContextMenuFor(event, `Actions for ${pose.name}`, poseMenu());
            }}
          />
        ))}
      </div>
      <RampControls />
    </div>
  );
}

interface PoseCardProps {
  name: string;
  label: string;
  problem?: string;
  isChosen: boolean;
  onChoose: (isAdded: boolean) => void;
  onMenu?: (event: MouseEvent) => void;
}

function PoseCard({ name, label, problem, isChosen, onChoose, onMenu }: PoseCardProps) {
  const card = useRef<HTMLButtonElement>(null);
  const isRenaming = useSignal(false);
  useEffect(() => {
    // Only sideways: on a phone the cards are at the end of a long panel.
    const [element, list] = [card.current, card.current?.parentElement];
    if (!isChosen || !element || !list) return;
    const last = element.offsetLeft - list.offsetLeft + element.offsetWidth - list.clientWidth;
    const first = element.offsetLeft - list.offsetLeft;
    list.scrollLeft = Math.min(Math.max(list.scrollLeft, last + CARD_GAP_PX), first - CARD_GAP_PX);
  }, [isChosen]);
  const rename = () => (isRenaming.value = name !== "");
  if (isRenaming.value) {
    return (
      <div class="pose-card renaming">
        <PosePicture name={name} />
        <NameInput
          name={name}
          fix={underscored}
          fixNote={UNDERSCORE_NOTE}
          onRename={(to) => renameOrReason("pose", name, to)}
          onDone={() => {
            isRenaming.value = false;
            setTimeout(() => card.current?.focus());
          }}
        />
      </div>
    );
  }
  return (
    <button
      ref={card}
      type="button"
      class="pose-card"
      aria-pressed={isChosen}
      aria-label={problem ? `${label}: ${problem}` : label}
      onClick={(event) => onChoose(event.ctrlKey || event.metaKey || event.shiftKey)}
      onContextMenu={onMenu}
      onDblClick={rename}
      onKeyDown={(event) => {
        if (event.key !== "F2") return;
        event.preventDefault();
        event.stopPropagation();
        rename();
      }}
    >
      <PosePicture name={name} />
      <span class="pose-card-label">
        {problem && <Icon name="warning" size={14} />}
        <span>{label}</span>
      </span>
    </button>
  );
}

/** The picture of a pose, or an icon until it is known. */
export function PosePicture({ name }: { name: string }) {
  const address = posePictures.value.get(name);
  return (
    <span class="pose-picture">
      {address ? (
        <img src={address} alt="" draggable={false} />
      ) : picturesState.value?.isComputing ? (
        <span class="spinner" aria-hidden="true" />
      ) : (
        <Icon name={name ? "pose" : "make"} size={24} />
      )}
    </span>
  );
}

function RampControls() {
  const pose = shownPose.value;
  if (!pose) return <SimulatedList />;
  const levels = simulatedStates.value?.levels ?? [];
  const isBusy = isLoading.value || isPlaying.value;
  const percent = Math.round(100 * share.value);
  return (
    <div class="ramp">
      <div class="ramp-row">
        <IconButton
          icon={isBusy ? "stop" : "play"}
          label={isBusy ? "Stop" : `Play ${pose.name} from rest`}
          shortcut="P"
          disabled={!isMeshed.value}
          onClick={() => void playRamp()}
        />
        <input
          class="range"
          type="range"
          min={0}
          max={1}
          step={0.01}
          list="ramp-levels"
          aria-label={`Share of ${pose.name}`}
          aria-valuetext={`${percent} %`}
          style={{ "--share": String(share.value) }}
          disabled={!isMeshed.value}
          value={share.value}
          onInput={(event) => setShare(event.currentTarget.valueAsNumber)}
        />
        <datalist id="ramp-levels">
          {levels.map((level) => (
            <option key={level} value={level} />
          ))}
        </datalist>
        <span class="ramp-percent">{percent} %</span>
      </div>
      <div class="ramp-levels" role="group" aria-label={`Simulated levels of ${pose.name}`}>
        {levels.map((level) => (
          <button
            key={level}
            type="button"
            class="level-chip"
            aria-pressed={share.value === level && !shownState.value}
            disabled={!isMeshed.value}
            onClick={() => setShare(level)}
          >
            {Math.round(100 * level)} %
          </button>
        ))}
        <RampNote />
      </div>
      <Forces pose={pose.name} />
    </div>
  );
}

function RampNote() {
  const known = ramp.value;
  if (isLoading.value) return <span class="muted">Solving from rest ...</span>;
  if (isSolving.value && !known) return <span class="muted">Solving ...</span>;
  if (known?.remark) return <span class="ramp-remark">{capital(known.remark)}</span>;
  return <span class="muted">{known?.isSimulated ? "As simulated" : ""}</span>;
}

function Forces({ pose }: { pose: string }) {
  const states = simulatedStates.value;
  const forces = states?.forces.find((other) => other.pose === pose);
  if (!forces?.held.length) return null;
  return (
    <p class="forces" {...tooltip("The force of a hand that moves the region, with the same work as the pose")}>
      Force of a hand:{" "}
      {forces.held.map(({ place, push, torque }) => (
        <span key={place}>
          <strong>{round2(Math.abs(push))} N</strong>
          {torque > 0 && <strong>, torque {round2(torque)} N m</strong>} at {place}
        </span>
      ))}
      {!states?.isCurrent && <span class="muted"> in the last simulation</span>}
      {forces.warning && (
        <span class="problem-text" {...tooltip(forces.warning)}>
          {forces.effort === "beyond" ? "More than one hand can do" : "Needs a whole hand"}
        </span>
      )}
    </p>
  );
}

/** The mixed states of the simulation; a pose alone has its own card. */
function SimulatedList() {
  const states = simulatedStates.value?.states.filter(({ weights }) => Object.keys(weights).length > 1) ?? [];
  if (!states.length || !isMeshed.value) {
    return <p class="muted ramp">{device.value?.poses.length ? "Choose a pose to scrub it." : "There is no pose yet."}</p>;
  }
  return (
    <div class="ramp">
      <span class="muted">Mixed states of the simulation</span>
      <div class="ramp-levels" role="group" aria-label="Mixed states">
        {states.map(({ name, weights, problem }) => (
          <button
            key={name}
            type="button"
            class="level-chip"
            aria-pressed={shownState.value === name}
            onClick={() => (shownState.value = shownState.value === name ? "" : name)}
          >
            {problem && <Icon name="warning" size={14} />}
            {Object.entries(weights)
              .map(([pose, weight]) => `${pose} ${Math.round(100 * weight)} %`)
              .join(" + ")}
          </button>
        ))}
      </div>
    </div>
  );
}

const round2 = (value: number): number => Number(value.toPrecision(2));
const capital = (text: string): string => `${text[0]!.toUpperCase()}${text.slice(1)}`;
