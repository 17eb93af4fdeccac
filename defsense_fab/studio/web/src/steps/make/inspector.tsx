// The state of the parts, the shown step, and the lists of what to print, cut, buy and check.
import type { Guide, MadeFile } from "../../protocol/messages";
import { inPageWords } from "../../state/page-words";
import { Button } from "../../ui/button";
import { Icon } from "../../ui/icons";
import { Section } from "../../ui/section";
import { BuildBanner } from "./build-banner";
import { GuideList } from "./guide-list";
import { StageCard } from "./stage-card";
import { openPlace } from "./open-place";
import { guide, stage } from "./state";

/** Titles of the lists by those of the guide. */
const TITLES: Record<string, string> = {
  Print: "Print list",
  "Bill of materials": "Shopping list",
};

export function MakeInspector() {
  const shown = guide.value;
  return (
    <div class="make-inspector">
      <BuildBanner />
      <StageCard />
      {shown?.id && <Lists shown={shown} isOpen={stage.value === null} />}
    </div>
  );
}

function Lists({ shown, isOpen }: { shown: Guide; isOpen: boolean }) {
  const { notes, lists, checks, files } = shown;
  const passedAt = checks?.header.indexOf("passed") ?? -1;
  const passed = checks?.rows.filter((row) => row[passedAt] === "yes").length ?? 0;
  return (
    <div class="make-lists" hidden={!isOpen}>
      {notes.length > 0 && (
        <Section title="Warnings" name="make.warnings" aside={notes.length}>
          <ul class="make-notes">
            {notes.map(({ text, point }) => (
              <li key={text}>
                <p>{inPageWords(text)}</p>
                {point && (
                  <Button variant="quiet" icon="eye" onClick={() => openPlace(point, text)}>
                    Show the place
                  </Button>
                )}
              </li>
            ))}
          </ul>
        </Section>
      )}
      {lists.map((list) => (
        <Section
          key={list.title}
          title={TITLES[list.title] ?? list.title}
          name={`make.${list.title}`}
          aside={list.rows.length}
        >
          <GuideList list={list} />
        </Section>
      ))}
      {checks && (
        <Section
          title="Checks"
          name="make.checks"
          isOpenAtFirst={passed < checks.rows.length}
          aside={`${passed} of ${checks.rows.length} passed`}
        >
          <GuideList list={checks} />
        </Section>
      )}
      <Section title="Files" name="make.files" aside={files.length}>
        <ul class="make-files">
          {files.map((file) => (
            <FileLink key={file.path} file={file} />
          ))}
        </ul>
      </Section>
    </div>
  );
}

function FileLink({ file: { title, name, path, size } }: { file: MadeFile }) {
  return (
    <li>
      <a href={path} download={name}>
        <Icon name="download" />
        {title}
      </a>
      <span class="muted">
        {name}, {fileSize(size)}
      </span>
    </li>
  );
}

function fileSize(bytes: number): string {
  return bytes < 1e6 ? `${Math.max(1, Math.round(bytes / 1e3))} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
}
