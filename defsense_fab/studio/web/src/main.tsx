import { useSignalEffect } from "@preact/signals";
import { render } from "preact";
import { listenForKeys } from "./commands";
import { livePage, LiveRoot } from "./live/live-root";
import { Banners } from "./shell/banners";
import { BrokenPage } from "./shell/broken-page";
import { CordQuestion } from "./shell/cord-question";
import { keepFocus } from "./shell/focus-keeper";
import { JobStrip } from "./shell/job-strip";
import { QuestionDialog } from "./shell/question-dialog";
import { Shell } from "./shell/shell";
import { Skeleton } from "./shell/skeleton";
import { StartPage } from "./start/start-page";
import { device } from "./state/connection";
import { screen } from "./state/step";
import "./steps";
import "./styles";
import { CommandPalette, KeyHelp } from "./ui/command-palette";
import { ConfirmLayer } from "./ui/dialog";
import { ToastLayer } from "./ui/feedback";
import { ContextMenuLayer } from "./ui/menu";
import { TooltipLayer } from "./ui/tooltip";

function Screen() {
  if (livePage.value) return <LiveRoot />;
  if (screen.value === "start") return <StartPage />;
  if (screen.value === "broken") return <BrokenPage />;
  if (screen.value === "device" && device.value) return <Shell />;
  return <Skeleton />;
}

function App() {
  useSignalEffect(() => {
    const name = screen.value === "start" ? "" : device.value?.name;
    const title = name ? `${name} - DefSense studio` : "DefSense studio";
    document.title = livePage.value?.title ?? title;
  });
  return (
    <>
      {!livePage.value && <Banners />}
      <Screen />
      <JobStrip />
      <QuestionDialog />
      <CordQuestion />
      <CommandPalette />
      <KeyHelp />
      <ConfirmLayer />
      <ContextMenuLayer />
      <ToastLayer />
      <TooltipLayer />
    </>
  );
}

listenForKeys();
keepFocus();
render(<App />, document.getElementById("app")!);
