import { useCommands } from "../commands";
import { isDrawerOpen, isLeftPanelOpen, isPhone } from "../state/layout";
import { step } from "../state/step";
import { stepCommands, stepPanels } from "../steps/registry";
import { BodyFitNotice } from "./body-fit-notice";
import { BottomPanel } from "./bottom-panel";
import { cordCommands } from "./cord-commands";
import { Inspector } from "./inspector";
import { Introduction } from "./introduction";
import { LeftPanel } from "./left-panel";
import { pageCommands } from "./page-commands";
import { focusScene } from "./regions";
import { SceneHost } from "./scene-host";
import { TopBar } from "./top-bar";

/** The page of a device. */
export function Shell() {
  useCommands(() => [...cordCommands(), ...pageCommands(), ...stepCommands()]);
  const panels = stepPanels(step.value);
  const isTreeOpen = isPhone.value ? isDrawerOpen.value : isLeftPanelOpen.value;
  return (
    <div class="shell">
      <button type="button" class="skip-link button plain" onClick={focusScene}>
        Skip to the scene
      </button>
      <TopBar />
      <div class="workspace">
        {isPhone.value && isTreeOpen && (
          <div class="drawer-backdrop" onClick={() => (isDrawerOpen.value = false)} />
        )}
        {isTreeOpen && <LeftPanel />}
        <main class="stage" aria-label="Scene">
          {panels?.toolbar && (
            <div class="scene-toolbar" role="toolbar" aria-label="Tools">
              <panels.toolbar />
            </div>
          )}
          <SceneHost isCovered={panels?.stage !== undefined} />
          {panels?.legend && (
            <div class="scene-legend">
              <panels.legend />
            </div>
          )}
          {panels?.stage && (
            <div class="scene-cover">
              <panels.stage />
            </div>
          )}
          <BodyFitNotice />
          <Introduction />
        </main>
        <Inspector />
        {!isPhone.value && <BottomPanel />}
      </div>
    </div>
  );
}
