/** The theme: the system's, or the one chosen at the bottom of any page. Runs before the page is drawn, so that it does not flash. */

{
  const stored = localStorage.getItem("theme") ?? "";
  const { dataset } = document.documentElement;
  dataset.theme = stored;
  document.addEventListener("DOMContentLoaded", () => {
    const label = document.createElement("label"), select = document.createElement("select");
    label.className = "theme";
    select.id = "theme";
    select.append(...[["", "system"], ["light", "light"], ["dark", "dark"]].map(([value, text]) => new Option(text, value, false, value === stored)));
    select.addEventListener("change", () => { dataset.theme = select.value; localStorage.setItem("theme", select.value); });
    label.append("Theme ", select);
    document.querySelector("body > footer")?.append(label);
  });
}
