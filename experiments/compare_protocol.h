// granopt: compare --protocol: each method drives a whole protocol by itself.

#ifndef GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_H_
#define GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_H_

#include <string>

namespace granopt {

// Runs the methods, or makes the tables and figures in `data` again from its
// setup.json. Exit statuses.
int CompareProtocols();
int ReplotProtocols(const std::string& data, const std::string& setup);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_COMPARE_PROTOCOL_H_
