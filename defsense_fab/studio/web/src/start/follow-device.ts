// Another device is another page: nothing of the earlier one may stay in this browser.
import { startIntroduction } from "../shell/introduction";
import { connection } from "../state/connection";

const INTRODUCTION = "defsense.introduction-wanted"; // in the storage of this tab

let folder: string | null = null;

connection.listen("page", (page) => {
  if (page.screen !== "device") return;
  if (folder !== null && folder !== page.folder) {
    location.reload();
    return;
  }
  if (sessionStorage.getItem(INTRODUCTION)) startIntroduction();
  sessionStorage.removeItem(INTRODUCTION);
  folder = page.folder;
});

/** Start the introduction with the next device, also if the page is loaded again for it. */
export function askForIntroduction(): void {
  sessionStorage.setItem(INTRODUCTION, "yes");
}
