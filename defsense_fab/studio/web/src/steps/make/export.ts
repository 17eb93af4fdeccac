// Saving everything that was built in one file.
import { signal } from "@preact/signals";
import { connection } from "../../state/connection";
import { attempt } from "../../state/run";
import { showToast } from "../../state/toasts";

export const isExporting = signal(false);
export const exportProblem = signal("");

/** Export the device as a zip file; a refusal is shown at the button. */
export async function exportDevice(): Promise<void> {
  exportProblem.value = "";
  isExporting.value = true;
  const answer = await attempt(connection.send("export-device", {}), ({ text }) => {
    exportProblem.value = text;
  });
  isExporting.value = false;
  if (!answer) return;
  save(answer.file.path, answer.file.name);
  showToast(`${answer.count} files are in ${answer.file.name}, also in the folder of the device`);
}

function save(path: string, name: string): void {
  const link = document.createElement("a");
  link.href = path;
  link.download = name;
  link.click();
}
