// granopt: preconditioners, which any method can use.

#ifndef GRANOPT_SOLVERS_PRECONDITIONER_H_
#define GRANOPT_SOLVERS_PRECONDITIONER_H_

#include <memory>
#include <string>

#include "solvers/monitor.h"
#include "solvers/registry.h"

namespace granopt {

// An accepted iterate.
struct Iterate {
  const double* x = nullptr;
  double cost = 0.0;
  const double* gradient = nullptr;
  Scales scales;
};

// A symmetric positive definite P that resembles the Hessian and is easy to
// invert (3.2). An object serves one run. P is fixed between calls of Update().
class Preconditioner {
 public:
  virtual ~Preconditioner() = default;

  // False with one line in `error` for a function without what P is made from.
  virtual bool Supports(const FirstOrderFunction& function,
                        std::string* error) const = 0;

  // Called at the start (step = null) and after each accepted step, which is
  // x - x_before. Makes P anew where the preconditioner's own policy says so;
  // returns true if it did. A factor that needs more memory than it may take
  // stops the run. Never fails otherwise: where no matrix can be made or
  // factored, P = (Scales::gradient / Scales::length) 1, counted by
  // num_fallbacks().
  virtual bool Update(const Iterate& at,
                      const double* step,
                      Monitor* monitor) = 0;

  // z = P^-1 r (17); n entries each, not the same array.
  virtual void Solve(const double* r, double* z, Monitor* monitor) = 0;

  // pv = P v.
  virtual void Multiply(const double* v, double* pv) const = 0;

  // u^T P v.
  double Dot(const double* u, const double* v, int n) const;

  int num_fallbacks() const { return num_fallbacks_; }

 protected:
  int num_fallbacks_ = 0;
};

// By itself, as CreateSolver() makes a method.
std::unique_ptr<Preconditioner> CreatePreconditioner(const std::string& spec,
                                                     std::string* error);

// The option `preconditioner=` of a method, together with the options of the
// one that is chosen.
class PreconditionerChoice {
 public:
  explicit PreconditionerChoice(Parameters* parameters);

  bool none() const { return factory_ == nullptr; }
  // False with one line in `error` if the chosen one cannot serve `function`.
  bool Supports(const FirstOrderFunction& function, std::string* error) const;
  // A new object for one run; null if none was chosen.
  std::unique_ptr<Preconditioner> Make() const;

 private:
  internal::PreconditionerFactory factory_ = nullptr;
  Parameters parameters_;
};

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_PRECONDITIONER_H_
