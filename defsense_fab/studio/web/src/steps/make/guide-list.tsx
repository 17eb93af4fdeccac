// A list of the guide as a table that fits into a narrow panel.
import type { GuideList as List } from "../../protocol/messages";
import { inPageWords } from "../../state/page-words";

/** More columns are shown as rows. */
const MAX_COLUMNS = 4;
/** Numbers and sizes, such as "30 x 14.2 x 8 mm". */
const IS_QUANTITY = /^[\d.,]+( [x×] [\d.,]+)*( \S{1,3})?$/;

/** A list; what is the same in all rows stands above it. */
export function GuideList({ list: { title, header, rows: texts } }: { list: List }) {
  const rows = texts.map((row) => row.map(inPageWords));
  const list = { title, header, rows };
  if (rows.length === 0) return <p class="muted">No entries</p>;
  const isShared = (k: number) => k > 0 && rows.length > 1 && rows.every((row) => row[k] === rows[0]![k]);
  const columns = header.map((_, k) => k);
  const shared = columns.filter((k) => isShared(k) && rows[0]![k]);
  const kept = columns.filter((k) => !isShared(k));
  return (
    <div class="guide-list">
      {shared.length > 0 && (
        <p class="muted">{shared.map((k) => `${heading(header[k]!)}: ${rows[0]![k]}`).join(" · ")}</p>
      )}
      {kept.length <= MAX_COLUMNS ? (
        <Rows list={list} kept={kept} />
      ) : (
        <Columns list={list} kept={kept} />
      )}
    </div>
  );
}

interface TableProps {
  list: List;
  kept: readonly number[];
}

function Rows({ list: { title, header, rows }, kept }: TableProps) {
  return (
    <table class="table">
      <caption class="visually-hidden">{title}</caption>
      <thead>
        <tr>
          {kept.map((k) => (
            <th key={k} scope="col">
              {heading(header[k]!)}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {rows.map((row, r) => (
          <tr key={r}>
            {kept.map((k, at) => 
              at === 0 ? (
                <th key={k} scope="row">{row[k]}</th>
              ) : (
                <td key={k} class={IS_QUANTITY.test(row[k]!) ? "unbroken" : undefined}>{row[k]}</td>
              ),
            )}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** A table whose rows stand next to each other. */
function Columns({ list: { title, header, rows }, kept }: TableProps) {
  return (
    <table class="table">
      <caption class="visually-hidden">{title}</caption>
      <thead>
        <tr>
          <th scope="col">{heading(header[kept[0]!]!)}</th>
          {rows.map((row, r) => (
            <th key={r} scope="col">
              {row[kept[0]!]}
            </th>
          ))}
        </tr>
      </thead>
      <tbody>
        {kept.slice(1).map((k) => (
          <tr key={k}>
            <th scope="row">{heading(header[k]!)}</th>
            {rows.map((row, r) => (
              <td key={r}>{row[k]}</td>
            ))}
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** A heading of the guide's files as a heading of the page. */
function heading(text: string): string {
  return text === "cm3" ? "cm³" : `${text[0]!.toUpperCase()}${text.slice(1)}`;
}
