// Poses that follow the body's vibration modes: search for them, look at them, and add them.
import { signal } from "@preact/signals";
import { connection, isJobActive, job } from "../../state/connection";
import { run } from "../../state/run";
import { select } from "../../state/selection";
import { Button } from "../../ui/button";
import { Section } from "../../ui/section";
import { SelectField } from "../../ui/select-field";
import { proposedPictures } from "./pictures";
import { isMeshed, proposedPoses, regions, shownProposal } from "./state";

const chosenRegion = signal("");

export function ProposedPoses() {
  const names = regions.value.map(({ name }) => name);
  const found = proposedPoses.value;
  const held = names.includes(chosenRegion.value) ? chosenRegion.value : (names[0] ?? "");
  const isSearching = isJobActive.value && job.value?.name === "search for poses";
  const poses = found?.held ? found.poses : [];
  return (
    <Section title="Proposed poses" name="poses.proposed" isOpenAtFirst={false} aside={poses.length || undefined}>
      <p class="muted">The softest ways in which the body moves while a region is held.</p>
      {names.length > 0 && (
        <SelectField
          label="Held region"
          value={held}
          choices={names.map((value) => ({ value, label: value }))}
          onCommit={(value) => {
            chosenRegion.value = value;
          }}
        />
      )}
      <Button
        isBusy={isSearching}
        disabled={names.length === 0 || isJobActive.value}
        hint={names.length === 0 ? "Add the region that holds the body first" : "Search for the lowest vibration modes"}
        onClick={() => void run(connection.send("propose-poses", { held }))}
      >
        Propose poses
      </Button>
      {found?.held && poses.length === 0 && <p>No mode was found that a moved region can follow.</p>}
      <ul class="item-list">
        {poses.map(({ name, frequency }) => (
          <li key={name} class="proposed-pose">
            <button
              type="button"
              class="item-row"
              aria-pressed={shownProposal.value === name}
              disabled={!isMeshed.value}
              onClick={() => (shownProposal.value = shownProposal.value === name ? "" : name)}
            >
              <ProposalPicture name={name} />
              <span>{name}</span>
              <span class="muted">{Number(frequency.toPrecision(3))} Hz</span>
            </button>
            <Button variant="quiet" icon="plus" aria-label={`Add ${name}`} onClick={() => void add([name])}>
              Add
            </Button>
          </li>
        ))}
      </ul>
      {poses.length > 1 && (
        <Button hint="Add all poses and their mixed states" onClick={() => void add(poses.map(({ name }) => name))}>
          Add all
        </Button>
      )}
      {found?.notes.map((text) => (
        <p key={text} class="muted">
          {text}
        </p>
      ))}
    </Section>
  );
}

function ProposalPicture({ name }: { name: string }) {
  const address = proposedPictures.value.get(name);
  return <span class="pose-picture">{address && <img src={address} alt="" draggable={false} />}</span>;
}

async function add(poses: string[]): Promise<void> {
  const added = await run(connection.send("add-proposed", { poses, hasStates: poses.length > 1 }));
  if (added) select({ kind: "pose", name: added.name });
}
