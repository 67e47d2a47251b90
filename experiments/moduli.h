// granopt: the elastic moduli that experiments report, and the flag that asks
// for them.

#ifndef GRANOPT_EXPERIMENTS_MODULI_H_
#define GRANOPT_EXPERIMENTS_MODULI_H_

#include <string>

#include "experiments/run.h"
#include "granular/contact_energy.h"
#include "granular/linear_response.h"

namespace granopt {

// Every modulus by its name (linear_response.h) and the elastic tensor.
Json ModuliJson(const ElasticResponse& response);

// If --moduli: adds "moduli" to `json` and returns the lines "moduli ..." of
// the report, else "".
std::string PublishModuli(const Packing& packing,
                          const ContactEnergyOptions& law,
                          Json* json);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_MODULI_H_
