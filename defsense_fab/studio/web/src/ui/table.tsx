import type { ComponentChildren } from "preact";

interface Column<T> {
  title: string;
  cell: (row: T) => ComponentChildren;
  isNumber?: boolean;
}

interface TableProps<T> {
  /** Name of the table, for screen readers. */
  caption: string;
  columns: readonly Column<T>[];
  rows: readonly T[];
  rowKey: (row: T) => string;
  /** Called with a row that is chosen; its first cell becomes a button. */
  onChoose?: (row: T) => void;
  isChosen?: (row: T) => boolean;
}

/** Rows of values; those of numbers are aligned at the right. */
export function Table<T>({ caption, columns, rows, rowKey, onChoose, isChosen }: TableProps<T>) {
  return (
    <table class={`table ${onChoose ? "choosable" : ""}`}>
      <caption class="visually-hidden">{caption}</caption>
      <thead>
        <tr>
          {columns.map(({ title, isNumber }) => (
            <th key={title} scope="col" class={isNumber ? "number" : ""}>
              {title}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {rows.map((row) => (
          <tr
            key={rowKey(row)}
            class={isChosen?.(row) ? "chosen" : ""}
            onClick={() => onChoose?.(row)}
          >
            {columns.map(({ title, cell, isNumber }, index) =>
              index === 0 ? (
                <th key={title} scope="row">
                  {onChoose ? (
                    <button type="button" class="cell-button" aria-pressed={isChosen?.(row)}>
                      {cell(row)}
                    </button>
                  ) : (
                    cell(row)
                  )}
                </th>
              ) : (
                <td key={title} class={isNumber ? "number" : ""}>
                  {cell(row)}
                </td>
              ),
            )}
          </tr>
        ))}
      </tbody>
    </table>
  );
}
