#include "experiments/report_text.h"

#include <cctype>
#include <map>

#include "solvers/format.h"

namespace granopt {

std::string Heading(const std::string& title, bool markdown) {
  return (markdown ? "## " : "\n") + title + "\n" + (markdown ? "\n" : "");
}

std::string PartHeading(std::string title, bool markdown) {
  if (markdown) title[0] = static_cast<char>(std::toupper(title[0]));
  return Heading(title, markdown);
}

std::string Block(const std::string& text, bool markdown) {
  return markdown ? text + "\n" : text;
}

std::string Lines(const std::vector<std::string>& lines, bool markdown) {
  std::string text;
  for (const std::string& line : lines) {
    text += (markdown ? "" : "  ") + line + "\n";
  }
  return text;
}

std::string Paragraph(const std::vector<std::string>& lines, bool markdown) {
  return Block(Lines(lines, markdown), markdown);
}

std::string Introduction(const std::string& title,
                         const std::string& what,
                         int repetitions,
                         std::size_t seeds,
                         const std::string& conditions,
                         const std::vector<Method>& methods) {
  std::string text = "# " + title + "\n\n" + what + "; " +
                     Plural(repetitions, "repetition") + ", " +
                     Plural(seeds, "seed") +
                     (conditions.empty() ? "" : "; " + conditions) + ".\n\n";
  for (const Method& method : methods) {
    if (method.label == method.spec) continue;
    text += "- " + method.label + ": `" + method.spec + "`\n";
  }
  return text + "\n";
}

std::string Plural(std::size_t count, const std::string& word) {
  return std::to_string(count) + " " + word + (count == 1 ? "" : "s");
}

std::string CountOrDash(int count) {
  return count == 0 ? "-" : std::to_string(count);
}

std::string Shares(double function_share, double linear_share) {
  const double f = 100.0 * function_share;
  const double l = 100.0 * linear_share;
  return Format("%.0f/%.0f/%.0f", f, l, std::max(0.0, 100.0 - f - l));
}

const char* HeadingOf(Cost cost) {
  constexpr Costs<const char*> kHeadings = {"iterations",
                                            "evaluations",
                                            "Hessians",
                                            "factors",
                                            "solves",
                                            "linear its",
                                            "CPU s"};
  return kHeadings[cost];
}

std::string WithInterval(int count, int trials) {
  const Interval interval = Wilson(count, trials);
  return Format("%d of %d (%.0f-%.0f %%)",
                count,
                trials,
                100.0 * interval.low,
                100.0 * interval.high);
}

std::string Spread(const Quantiles& q,
                   double spent,
                   const std::function<std::string(double)>& print) {
  if (std::isnan(q.median)) return "-";
  if (std::isinf(q.median)) {
    return std::isnan(spent) ? "-" : ">" + print(spent);
  }
  // Of work that no run did, the failed ones did none either.
  if (q.low == 0.0 && q.median == 0.0 && std::isinf(q.high)) return print(0.0);
  const std::string middle = print(q.median);
  const std::string low = print(q.low), high = print(q.high);
  if (low == middle && high == middle) return middle;
  return middle + " (" + low + "-" + high + ")";
}

std::string WithWorst(const MedianWorst& value,
                      const MedianWorst& spent,
                      const std::function<std::string(double)>& print) {
  if (std::isnan(value.median)) return "-";
  // Of work that no run did, the failed ones did none either.
  if (spent.worst == 0.0) return print(0.0);
  if (std::isinf(value.median)) return ">" + print(spent.median);
  const std::string median = print(value.median), worst = print(value.worst);
  return median == worst ? median : median + " (" + worst + ")";
}

std::string Tally(const std::vector<std::string>& words) {
  std::map<std::string, int> count;
  for (const std::string& word : words) ++count[word];
  if (count.empty()) return "not run";
  if (count.size() == 1) return count.begin()->first;
  std::string text;
  for (const auto& [word, n] : count) {
    text += (text.empty() ? "" : ", ") + word + " " + std::to_string(n);
  }
  return text;
}

}  // namespace granopt
