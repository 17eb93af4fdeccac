// Bars across the page: the server does not answer, or the device's file is not followed.
import { connection, page } from "../state/connection";
import { run } from "../state/run";
import { Button } from "../ui/button";
import { Icon } from "../ui/icons";

export function Banners() {
  const problem = page.value?.screen === "device" ? page.value.problem : null;
  return (
    <div class="banners">
      {connection.isLost.value && (
        <div class="banner warning" role="alert">
          <span class="spinner" aria-hidden="true" />
          <p>The studio does not answer; your changes are saved. Reconnecting ...</p>
        </div>
      )}
      {problem && (
        <div class="banner danger" role="alert">
          <Icon name="error" />
          <p>{problem.text}</p>
          {problem.code !== "folder-missing" && (
            <Button onClick={() => void run(connection.send("restore", {}))}>
              Restore the last valid file
            </Button>
          )}
        </div>
      )}
    </div>
  );
}
