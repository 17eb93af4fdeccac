// The inspector of the step Poses: the selected pose or region, or what there is.
import { select, selection } from "../../state/selection";
import { Button } from "../../ui/button";
import { EmptyState } from "../../ui/feedback";
import { Icon } from "../../ui/icons";
import { Section } from "../../ui/section";
import { addPose, addRegion, deletePoses, deleteRegions } from "./commands";
import { MeshNotice } from "./mesh-notice";
import { PosePanel } from "./pose-panel";
import { ProposedPoses } from "./proposed-poses";
import { RegionPanel } from "./region-panel";
import { PosePicture } from "./state-strip";
import { editedRegion, isMeshed, posesState, regions, selectedPoses, selectedRegions, shownPose, simulatedStates } from "./state";
import { poseProblem } from "./warnings";

export function PosesInspector() {
  const region = editedRegion.value;
  const pose = shownPose.value;
  const [poses, chosen] = [selectedPoses(), selectedRegions()];
  return (
    <>
      <MeshNotice />
      {poses.length + chosen.length > 1 ? (
        <Several poses={poses} regions={chosen} />
      ) : region ? (
        <RegionPanel key={region.name} region={region} />
      ) : pose ? (
        <PosePanel key={pose.name} pose={pose} />
      ) : (
        <Overview />
      )}
    </>
  );
}

function Several({ poses, regions: names }: { poses: string[]; regions: string[] }) {
  const parts = [
    poses.length && `${poses.length} ${poses.length === 1 ? "pose" : "poses"}`,
    names.length && `${names.length} ${names.length === 1 ? "region" : "regions"}`,
  ];
  return (
    <div class="panel-body several-items">
      <h2>{parts.filter(Boolean).join(" and ")} selected</h2>
      {poses.length > 0 && (
        <Button icon="trash" onClick={() => void deletePoses(poses)}>
          Delete the poses
        </Button>
      )}
      {names.length > 0 && (
        <Button icon="trash" onClick={() => void deleteRegions(names)}>
          Delete the regions
        </Button>
      )}
      <Button variant="quiet" onClick={() => (selection.value = [])}>
        Select nothing
      </Button>
    </div>
  );
}

function Overview() {
  const poses = posesState.value?.poses ?? [];
  const warnings = simulatedStates.value?.warnings ?? [];
  return (
    <>
      <Section title="Poses" name="poses.list" aside={poses.length}>
        {poses.length === 0 && <NoPose />}
        <ul class="item-list">
          {poses.map((pose) => (
            <li key={pose.name}>
              <button
                type="button"
                class="item-row"
                onClick={() => select({ kind: "pose", name: pose.name })}
              >
                <PosePicture name={pose.name} />
                <span>{pose.name}</span>
                {poseProblem(pose) && <Icon name="warning" size={14} />}
              </button>
            </li>
          ))}
        </ul>
      </Section>
      <Section title="Regions" name="regions.list" aside={regions.value.length}>
        {regions.value.length === 0 && <NoRegion />}
        <ul class="item-list">
          {regions.value.map(({ name, color, count, problems }) => (
            <li key={name}>
              <button type="button" class="item-row" onClick={() => select({ kind: "region", name })}>
                <span class="swatch region" style={{ background: color }} />
                <span>{name}</span>
                {problems.length > 0 && <Icon name="warning" size={14} />}
                {isMeshed.value && <span class="muted">{count} points</span>}
              </button>
            </li>
          ))}
        </ul>
      </Section>
      {warnings.length > 0 && (
        <Section title="Warnings of the simulation" name="poses.warnings" aside={warnings.length}>
          {warnings.map((text) => (
            <p key={text} class="warning-text">
              <Icon name="warning" size={14} /> <span>{text}</span>
            </p>
          ))}
        </Section>
      )}
      <ProposedPoses />
    </>
  );
}

function NoPose() {
  const canPose = regions.value.length > 1;
  return (
    <EmptyState
      icon="pose"
      text={
        canPose
          ? "A pose is a deformation that the device senses: it holds a region and moves another."
          : "A pose needs two regions: one to hold and one to move."
      }
      action={canPose && <Button onClick={() => void addPose()}>Add a pose</Button>}
    />
  );
}

function NoRegion() {
  return (
    <EmptyState
      icon="region"
      text="A region is a part of the body that poses hold or move. Hold Shift and drag a rectangle over it."
      action={<Button onClick={() => void addRegion("box")}>Add a region</Button>}
    />
  );
}
