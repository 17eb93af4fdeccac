// The devices that were opened before.
import { signal } from "@preact/signals";
import type { RecentDevice } from "../protocol/messages";
import { connection } from "../state/connection";
import { run } from "../state/run";
import { showDevice } from "../state/step";
import { Button, IconButton } from "../ui/button";
import { Icon } from "../ui/icons";
import { tooltip } from "../ui/tooltip";

export const recentDevices = connection.event("recent-devices");

/** Where a new device with a name is created, in words. */
export function newFolder(name: string): string {
  const { folder = "", isNewFolder = false } = recentDevices.value ?? {};
  return isNewFolder ? `In a new folder for “${name.trim()}” in ${folder}` : `In ${folder}`;
}

const FEW = 5;
const areAllShown = signal(false);

/** Cards of the last devices, or of all recent ones; a missing one can only be removed. */
export function RecentDeviceList() {
  const devices = recentDevices.value?.devices ?? [];
  const shown = areAllShown.value ? devices : devices.slice(0, FEW);
  return (
    <>
      <ul class="card-grid recent">
        {shown.map((device) => (
          <li key={device.folder}>
            <RecentCard device={device} />
          </li>
        ))}
      </ul>
      {devices.length > FEW && (
        <Button variant="quiet" onClick={() => (areAllShown.value = !areAllShown.value)}>
          {areAllShown.value ? "Show fewer" : `Show all ${devices.length}`}
        </Button>
      )}
    </>
  );
}

function RecentCard({ device }: { device: RecentDevice }) {
  const { name, folder, picture, isMissing, isOpen, openedAt } = device;
  const open = async () => {
    if (isOpen) showDevice();
    else if ((await run(connection.send("open-device", { folder }))) !== undefined) showDevice();
  };
  const remove = () => void run(connection.send("forget-device", { folder }));
  const state = isMissing ? "Missing" : isOpen ? "Open" : timeAgo(openedAt);
  return (
    <div class={`recent-card ${isMissing ? "missing" : ""}`}>
      <button
        type="button"
        class="device-card"
        aria-disabled={isMissing || undefined}
        aria-label={`${name}, ${isMissing ? "missing" : isOpen ? "open" : `opened ${timeAgo(openedAt)}`}`}
        aria-description={folder}
        onClick={() => !isMissing && void open()}
        {...tooltip(isMissing ? `${folder} has no device any more` : folder)}
      >
        <span class="card-picture">
          {picture ? <img src={picture} alt="" /> : <Icon name={isMissing ? "warning" : "make"} size={32} />}
        </span>
        <span class="card-body">
          <strong>{name}</strong>
          <span class="card-folder">
            <bdi>{folder}</bdi>
          </span>
          <span class={`card-state ${isMissing ? "warning" : isOpen ? "open" : ""}`}>{state}</span>
        </span>
      </button>
      <IconButton icon="close" label={`Remove ${name} from the list`} class="card-remove" onClick={remove} />
    </div>
  );
}

const UNITS: readonly [Intl.RelativeTimeFormatUnit, number][] = [
  ["year", 31_557_600],
  ["month", 2_629_800],
  ["week", 604_800],
  ["day", 86_400],
  ["hour", 3600],
  ["minute", 60],
];
const relative = new Intl.RelativeTimeFormat("en", { numeric: "auto" });

/** How long ago a time in s since 1970 was, in words. */
function timeAgo(at: number): string {
  const age = Date.now() / 1000 - at;
  const [unit, size] = UNITS.find(([, seconds]) => age >= seconds) ?? ["minute", 60];
  return age < 60 ? "just now" : relative.format(-Math.floor(age / size), unit);
}
