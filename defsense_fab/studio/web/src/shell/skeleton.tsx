/** The page before the server has answered. */
export function Skeleton() {
  return (
    <div class="skeleton" role="status" aria-label="Loading">
      <div class="skeleton-bar" />
      <div class="skeleton-panel">
        <i />
        <i />
        <i />
        <i />
      </div>
      <div class="skeleton-scene">
        <p>Waiting for the studio ...</p>
      </div>
      <div class="skeleton-panel">
        <i />
        <i />
        <i />
      </div>
    </div>
  );
}
