// granopt: pieces of reports, which are written for the terminal and as
// Markdown.

#ifndef GRANOPT_EXPERIMENTS_REPORT_TEXT_H_
#define GRANOPT_EXPERIMENTS_REPORT_TEXT_H_

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "experiments/comparison_records.h"
#include "experiments/statistics.h"

namespace granopt {

std::string Heading(const std::string& title, bool markdown);
// Of a part that is no table: with a capital letter in Markdown.
std::string PartHeading(std::string title, bool markdown);
// `text` as a block of its own: followed by an empty line in Markdown.
std::string Block(const std::string& text, bool markdown);
// Each indented on a terminal.
std::string Lines(const std::vector<std::string>& lines, bool markdown);
// The same, as a block.
std::string Paragraph(const std::vector<std::string>& lines, bool markdown);
// Title, what was compared how often, and the methods that have labels. In
// Markdown only: a terminal has seen the plan.
std::string Introduction(const std::string& title,
                         const std::string& what,
                         int repetitions,
                         std::size_t seeds,
                         const std::string& conditions,
                         const std::vector<Method>& methods);

// "1 seed", "3 seeds".
std::string Plural(std::size_t count, const std::string& word);
// "-" for none.
std::string CountOrDash(int count);
// "2015", "2015 (1980-2100)"; ">5000" (spent) if the median run never got
// there.
std::string Spread(const Quantiles& q,
                   double spent,
                   const std::function<std::string(double)>& print);
// "12", "12 (40)", "12 (never)"; ">500" (spent) if the median step never got
// there.
std::string WithWorst(const MedianWorst& value,
                      const MedianWorst& spent,
                      const std::function<std::string(double)>& print);
// "A", or "A 2, B 1" with the number of runs.
std::string Tally(const std::vector<std::string>& words);
// "60/30/10": percents of the time in the function, in linear algebra and
// elsewhere.
std::string Shares(double function_share, double linear_share);
// "3 of 7 (16-75 %)", with Wilson's interval.
std::string WithInterval(int count, int trials);

// "Hessians", "CPU s", ... of columns.
const char* HeadingOf(Cost cost);
// Those of `costs` that say something: a row has a finite median above 0.
// Rows have members costs, whose elements have a median.
template <typename Row>
std::vector<Cost> WithWork(const std::vector<Row>& rows,
                           const std::vector<Cost>& costs) {
  std::vector<Cost> kept;
  for (const Cost cost : costs) {
    if (std::any_of(rows.begin(), rows.end(), [cost](const Row& row) {
          const double median = row.costs[cost].median;
          return std::isfinite(median) && median > 0.0;
        })) {
      kept.push_back(cost);
    }
  }
  return kept;
}

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_REPORT_TEXT_H_
