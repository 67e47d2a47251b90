#include "experiments/identify_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "experiments/identify_flags.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"

namespace granopt::identify {

void PrintIdentification(const Task& task, const Identification& id, int rows) {
  const SearchResult& r = id.search.result;
  std::printf(
      "\n  %d strings, %lld runs (%.2f a string); the search reports P = %.4f\n"
      "  on %d fresh starts, the same for all:\n\n",
      r.strings,
      static_cast<long long>(id.search.runs),
      static_cast<double>(id.search.runs) / std::max(1, r.strings),
      r.value,
      FLAGS_fresh);
  std::vector<std::vector<std::string>> table(1);
  table[0].push_back("from");
  for (const SearchedFlag& flag : task.flags) table[0].push_back(flag.name);
  for (const char* name :
       {"P reported", "P, fresh", "+- 95 %", "above best", "+- 95 %"}) {
    table[0].push_back(name);
  }
  table[0].push_back("");
  int own = 0;
  for (const Candidate& c : id.candidates) {
    if (c.origin == "search" && ++own > rows) continue;
    const double factor =
        ConfidenceFactor(static_cast<int>(c.fresh.values.size()));
    std::vector<std::string> row = {c.origin};
    for (const double v : c.string) row.push_back(Format("%.4f", v));
    row.push_back(std::isfinite(c.reported) ? Format("%.4f", c.reported) : "");
    row.push_back(Format("%.4f", c.fresh.mean()));
    row.push_back(Format("%.4f", factor * c.fresh.error()));
    row.push_back(Format("%.4f", c.difference));
    row.push_back(Format("%.4f", factor * c.difference_error));
    row.push_back(c.is_equal ? "equal" : "");
    table.push_back(row);
  }
  std::fputs(Grid(table, 1, false).c_str(), stdout);
  const Candidate& best = id.candidates[id.best];
  std::printf(
      "\n  confirmed     P = %.4f +- %.4f (95 %%) on %zu other starts\n",
      id.confirmed.mean(),
      ConfidenceFactor(static_cast<int>(id.confirmed.values.size())) *
          id.confirmed.error(),
      id.confirmed.values.size());
  std::string text;
  for (std::size_t k = 0; k < task.flags.size(); ++k) {
    text += Format("%s%s %.3g (%.3g to %.3g)",
                   k == 0 ? "" : ", ",
                   task.flags[k].name.c_str(),
                   best.string[k],
                   id.valley.low[k],
                   id.valley.high[k]);
  }
  std::printf(
      "  parameters    %s\n"
      "                in brackets: over the %d strings that %d starts "
      "do not tell from the best\n",
      text.c_str(),
      id.equal,
      FLAGS_fresh);
  if (id.valley.axis.empty()) {
    std::printf("                too few of them to say what is determined\n");
    return;
  }
  std::printf(
      "  determined    deviations of those along their principal axes, "
      "of the box:\n");
  for (std::size_t a = 0; a < id.valley.axis.size(); ++a) {
    std::string axis;
    for (std::size_t k = 0; k < task.flags.size(); ++k) {
      axis +=
          Format(" %+.2f %s", id.valley.axis[a][k], task.flags[k].name.c_str());
    }
    std::printf(
        "                %.3f along%s\n", id.valley.deviation[a], axis.c_str());
  }
}

Json IdentificationJson(const Task& task, const Identification& id) {
  const auto named = [&](const std::vector<double>& values) {
    Json json = Json::object();
    for (std::size_t k = 0; k < task.flags.size(); ++k) {
      json[task.flags[k].name] = values[k];
    }
    return json;
  };
  const auto number = [](double v) {
    return std::isfinite(v) ? Json(v) : Json();
  };
  const Candidate& best = id.candidates[id.best];
  const SearchResult& r = id.search.result;
  Json json = {{"strings", r.strings},
               {"runs", id.search.runs},
               {"reported", number(r.value)},
               {"reported_string", named(r.best)},
               {"message", r.message}};
  json["best"] = {{"string", named(best.string)},
                  {"origin", best.origin},
                  {"fresh", number(best.fresh.mean())},
                  {"fresh_error", number(best.fresh.error())},
                  {"confirmed", number(id.confirmed.mean())},
                  {"confirmed_error", number(id.confirmed.error())},
                  {"starts", FLAGS_fresh}};
  json["equal_strings"] = id.equal;
  json["equal_low"] = named(id.valley.low);
  json["equal_high"] = named(id.valley.high);
  json["axes"] = Json::array();
  for (std::size_t a = 0; a < id.valley.axis.size(); ++a) {
    json["axes"].push_back({{"deviation", id.valley.deviation[a]},
                            {"direction", named(id.valley.axis[a])}});
  }
  json["candidates"] = Json::array();
  for (const Candidate& c : id.candidates) {
    if (c.origin == "search") continue;
    json["candidates"].push_back(
        {{"origin", c.origin},
         {"string", named(c.string)},
         {"reported", number(c.reported)},
         {"fresh", number(c.fresh.mean())},
         {"fresh_error", number(c.fresh.error())},
         {"above_best", number(c.difference)},
         {"above_best_error", number(c.difference_error)},
         {"equal", c.is_equal}});
  }
  json["cpu_seconds"] = id.cpu;
  return json;
}

std::string Values(const std::vector<double>& string) {
  std::string text;
  for (const double v : string) text += Format(",%.17g", v);
  return text;
}

std::string FreshCsv(const Task& task, const Identification& id) {
  std::string csv = "origin";
  for (const SearchedFlag& flag : task.flags) csv += "," + flag.name;
  csv += ",reported,fresh,fresh_error,above_best,above_best_error,equal\n";
  for (const Candidate& c : id.candidates) {
    csv += Field(c.origin) + Values(c.string) +
           Format(",%.17g,%.17g,%.17g,%.17g,%.17g,%d\n",
                  c.reported,
                  c.fresh.mean(),
                  c.fresh.error(),
                  c.difference,
                  c.difference_error,
                  c.is_equal ? 1 : 0);
  }
  return csv;
}

std::string HistoryCsv(const Identification& id) {
  std::string csv = "list,strings,best,list_mean,fresh,fresh_error\n";
  const std::vector<SearchRow>& history = id.search.result.history;
  for (std::size_t k = 0; k < history.size(); ++k) {
    const SearchRow& row = history[k];
    double fresh = NAN, error = NAN;
    for (const Candidate& c : id.candidates) {
      if (c.string == row.best_string) {
        fresh = c.fresh.mean();
        error = c.fresh.error();
      }
    }
    csv += Format("%zu,%d,%.17g,%.17g,%.17g,%.17g\n",
                  k,
                  row.strings,
                  row.best,
                  row.list_mean,
                  fresh,
                  error);
  }
  return csv;
}

std::string StringsCsv(const Task& task, const Record& record) {
  std::string csv = "stage,index";
  for (const SearchedFlag& flag : task.flags) csv += "," + flag.name;
  csv += ",runs,mean,error\n";
  for (const auto& [name, stage] : record.stages()) {
    for (std::size_t k = 0; k < stage.next; ++k) {
      const Ensemble& e = stage.done[k];
      csv += Format("%s,%zu", name.c_str(), k) + Values(e.string) +
             Format(",%zu,%.17g,%.17g\n", e.values.size(), e.mean(), e.error());
    }
  }
  return csv;
}

}  // namespace granopt::identify
