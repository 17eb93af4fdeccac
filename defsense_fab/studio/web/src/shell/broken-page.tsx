import { connection, page } from "../state/connection";
import { run } from "../state/run";
import { Button } from "../ui/button";
import { Icon } from "../ui/icons";

/** The page of a device whose file cannot be read. */
export function BrokenPage() {
  const { folder = "", problem = null } = page.value ?? {};
  return (
    <main class="broken-page">
      <span class="broken-icon">
        <Icon name="error" size={32} />
      </span>
      <h1>This device cannot be opened</h1>
      <p class="broken-text" role="alert">
        {problem?.text}
      </p>
      <p>
        The page continues when the file is corrected in <code>{folder}</code>, with any editor.
      </p>
      <Button
        variant="primary"
        icon="undo"
        onClick={() => void run(connection.send("restore", {}))}
      >
        Restore the last valid file
      </Button>
    </main>
  );
}
