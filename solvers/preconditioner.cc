#include "solvers/preconditioner.h"

#include <cmath>
#include <map>
#include <sstream>

namespace granopt {

double Preconditioner::Dot(const double* u, const double* v, int n) const {
  std::vector<double> pv(n);
  Multiply(v, pv.data());
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += u[i] * pv[i];
  return sum;
}

double Preconditioner::Norm(const double* v, int n) const {
  return std::sqrt(Dot(v, v, n));
}

std::unique_ptr<Preconditioner> CreatePreconditioner(const std::string& spec,
                                                     std::string* error) {
  const std::size_t colon = spec.find(':');
  const std::string name = spec.substr(0, colon);
  const internal::PreconditionerFactory factory =
      internal::FindPreconditioner(name);
  if (factory == nullptr) {
    std::string known;
    for (const std::string& one : internal::PreconditionerNames()) {
      known += (known.empty() ? "" : ", ") + one;
    }
    *error = "unknown preconditioner '" + name + "' (known: " + known + ")";
    return nullptr;
  }
  const std::string head = "preconditioner '" + spec + "': ";
  std::map<std::string, std::string> values;
  std::istringstream items(colon == std::string::npos ? ""
                                                      : spec.substr(colon + 1));
  for (std::string item; std::getline(items, item, ',');) {
    const std::size_t equals = item.find('=');
    if (equals == std::string::npos || equals == 0) {
      *error = head + "'" + item + "' is not key=value";
      return nullptr;
    }
    const std::string key = item.substr(0, equals);
    if (!values.emplace(key, item.substr(equals + 1)).second) {
      *error = head + "option '" + key + "' is given twice";
      return nullptr;
    }
  }
  Parameters parameters(std::move(values));
  std::unique_ptr<Preconditioner> made = factory(&parameters);
  const std::string problem = parameters.Error();
  if (problem.empty()) return made;
  *error = head + problem;
  return nullptr;
}

PreconditionerChoice::PreconditionerChoice(Parameters* parameters) {
  std::string names = "none";
  const std::vector<std::string> known = internal::PreconditionerNames();
  for (const std::string& name : known) names += "|" + name;
  const int chosen = parameters->Choice(
      "preconditioner", "none", names, "P of (17), see below");
  if (chosen == 0) return;
  factory_ = internal::FindPreconditioner(known[chosen - 1]);
  // Reads its options, so that they are known and checked.
  factory_(parameters);
  parameters_ = *parameters;
}

bool PreconditionerChoice::Supports(const FirstOrderFunction& function,
                                    std::string* error) const {
  return none() || Make()->Supports(function, error);
}

std::unique_ptr<Preconditioner> PreconditionerChoice::Make() const {
  if (none()) return nullptr;
  Parameters parameters = parameters_;
  return factory_(&parameters);
}

}  // namespace granopt
