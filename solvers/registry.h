// granopt: methods by name.

#ifndef GRANOPT_SOLVERS_REGISTRY_H_
#define GRANOPT_SOLVERS_REGISTRY_H_

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "solvers/solver.h"

namespace granopt {

class Preconditioner;

// The `key=value` options of one method. A method's constructor reads each
// option once, with its default and help; that call is the only place where the
// option is stated, and it is what --list_solvers prints.
class Parameters {
 public:
  struct Spec {
    std::string key;
    std::string default_value;
    std::string choices;  // "0|1", "fr|pr|hs", "integer >= 1", ...
    std::string help;
  };

  Parameters() = default;
  explicit Parameters(std::map<std::string, std::string> values)
      : values_(std::move(values)) {}

  bool Bool(const std::string& key,
            bool default_value,
            const std::string& help);
  int Int(const std::string& key,
          int default_value,
          int minimum,
          const std::string& help);
  // minimum <= value <= maximum.
  double Double(const std::string& key,
                double default_value,
                double minimum,
                double maximum,
                const std::string& help);
  // One of `choices` ("a|b|c"); returns its index.
  int Choice(const std::string& key,
             const std::string& default_value,
             const std::string& choices,
             const std::string& help);

  // A value that does not go with other options, or that this build is
  // without: "option key=value why".
  void Refuse(const std::string& key,
              const std::string& value,
              const std::string& why);

  const std::vector<Spec>& specs() const { return specs_; }
  // The first thing found wrong: a value that does not parse, or a key that no
  // call above asked for. Empty if all is well.
  std::string Error() const;

 private:
  // The given text, or null; records the spec.
  const std::string* Take(const std::string& key,
                          const std::string& default_value,
                          const std::string& choices,
                          const std::string& help);
  void Complain(const std::string& key,
                const std::string& value,
                const std::string& choices);

  std::map<std::string, std::string> values_;
  std::vector<Spec> specs_;
  std::string error_;
};

// A registered method or preconditioner.
struct SolverInfo {
  std::string name;
  std::string summary;   // one line
  std::string citation;  // where the method is published
  std::vector<Parameters::Spec> options;
};

// Makes the method that `spec` = "name" or "name:key=value,key=value"
// describes. Returns null and one line in `error` for an unknown name (the
// known ones are listed), an unknown option or a value that does not fit.
// "spec|spec|..." is a SolverSequence: the next starts where one gave up.
std::unique_ptr<Solver> CreateSolver(const std::string& spec,
                                     std::string* error);

// Every registered method, by name.
std::vector<SolverInfo> ListSolvers();
// Every registered preconditioner, by name, with its own options.
std::vector<SolverInfo> ListPreconditioners();

// The table that `--list_solvers` prints: names, lines, options, citations.
std::string SolverTable();

namespace internal {

using SolverFactory = std::unique_ptr<Solver> (*)(Parameters*);
void RegisterSolver(const std::string& name,
                    const std::string& summary,
                    const std::string& citation,
                    SolverFactory factory);

using PreconditionerFactory = std::unique_ptr<Preconditioner> (*)(Parameters*);
void RegisterPreconditioner(const std::string& name,
                            const std::string& summary,
                            const std::string& citation,
                            PreconditionerFactory factory);
std::vector<std::string> PreconditionerNames();
// Null for an unknown name.
PreconditionerFactory FindPreconditioner(const std::string& name);

}  // namespace internal
}  // namespace granopt

// Registers `Class` (constructed from a Parameters*) under `name`, which is the
// name of the file in solvers/methods. CMake calls the function defined here
// for every file of that folder, so that a static library loses no method.
#define REGISTER_SOLVER(name, Class, summary, citation) \
  void GranoptRegister_##name() {                       \
    ::granopt::internal::RegisterSolver(                \
        #name,                                          \
        summary,                                        \
        citation,                                       \
        [](::granopt::Parameters* parameters)           \
            -> std::unique_ptr<::granopt::Solver> {     \
          return std::make_unique<Class>(parameters);   \
        });                                             \
  }                                                     \
  static_assert(true, "")

// The same for preconditioners in solvers/preconditioners. Another library
// calls GranoptRegister_<name>() itself, before the first CreateSolver().
#define REGISTER_PRECONDITIONER(name, Class, summary, citation) \
  void GranoptRegister_##name() {                               \
    ::granopt::internal::RegisterPreconditioner(                \
        #name,                                                  \
        summary,                                                \
        citation,                                               \
        [](::granopt::Parameters* parameters)                   \
            -> std::unique_ptr<::granopt::Preconditioner> {     \
          return std::make_unique<Class>(parameters);           \
        });                                                     \
  }                                                             \
  static_assert(true, "")

#endif  // GRANOPT_SOLVERS_REGISTRY_H_
