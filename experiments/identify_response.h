// granopt: energies of a string over time.

#ifndef GRANOPT_EXPERIMENTS_IDENTIFY_RESPONSE_H_
#define GRANOPT_EXPERIMENTS_IDENTIFY_RESPONSE_H_

#include <string>
#include <vector>

#include "experiments/identify_runs.h"
#include "experiments/run.h"

namespace granopt::identify {

// Energies of a string on a grid of times, from `starts` starts.
struct Response {
  std::vector<double> time;
  std::vector<EnergyCurve> curves;
  int failed = 0;
};

Response RunResponse(const Task& task,
                     const std::vector<double>& string,
                     int starts,
                     Stream stream);

// Of at least one.
EnergyCurve MeanCurve(const Response& response);

// How far the response is from a target that has errors, in those errors:
// prints it and returns it by energy. Null without errors.
Json ReportErrors(const Task& task, const Response& response);

std::string ResponseCsv(const Response& response, const EnergyCurve& target);

}  // namespace granopt::identify

#endif  // GRANOPT_EXPERIMENTS_IDENTIFY_RESPONSE_H_
