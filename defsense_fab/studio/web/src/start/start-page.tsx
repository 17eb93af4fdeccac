import { PageMenu } from "../shell/page-menu";
import { device } from "../state/connection";
import { canReturn, showDevice } from "../state/step";
import { Button } from "../ui/button";
import { BodyForm } from "./body-form";
import { DropZone } from "./drop-zone";
import "./device-picture";
import "./follow-device";
import { Gallery } from "./gallery";
import { IntroductionOffer } from "./introduction-offer";
import { RecentDeviceList, recentDevices } from "./recent-devices";
import "./start.css";
import { uploadedBody } from "./upload";

/** The page of all devices: open one, or create one. */
export function StartPage() {
  if (uploadedBody.value) return <BodyForm body={uploadedBody.value} />;
  const hasRecent = (recentDevices.value?.devices.length ?? 0) > 0;
  // A folder without a device was given for a new one.
  const recent = hasRecent && (
    <section aria-labelledby="recent-title">
      <h2 id="recent-title">Recent devices</h2>
      <RecentDeviceList />
    </section>
  );
  return (
    <div class="start">
      <header class="start-header">
        <h1>DefSense studio</h1>
        {canReturn.value && (
          <Button icon="arrowLeft" onClick={showDevice}>
            Back to {device.value?.name ?? "the device"}
          </Button>
        )}
        <PageMenu />
      </header>
      <main class="start-content">
        <IntroductionOffer />
        {canReturn.value && recent}
        <section aria-labelledby="new-title">
          <h2 id="new-title">New device</h2>
          <DropZone />
          <h3 class="start-subtitle">Or start from an example, and change it as you like</h3>
          <Gallery />
        </section>
        {!canReturn.value && recent}
      </main>
    </div>
  );
}
