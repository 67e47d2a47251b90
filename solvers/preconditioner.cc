#include "solvers/preconditioner.h"

#include <string>
#include <vector>

namespace granopt {

double Preconditioner::Dot(const double* u, const double* v, int n) const {
  std::vector<double> pv(n);
  Multiply(v, pv.data());
  double sum = 0.0;
  for (int i = 0; i < n; ++i) sum += u[i] * pv[i];
  return sum;
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
