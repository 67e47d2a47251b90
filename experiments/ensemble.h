// granopt: many packings, --seeds=1-20, and their jamming points.

#ifndef GRANOPT_EXPERIMENTS_ENSEMBLE_H_
#define GRANOPT_EXPERIMENTS_ENSEMBLE_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/run.h"
#include "granular/contact_energy.h"
#include "granular/distributions.h"

namespace granopt {

// What --seeds, --sizes and --jobs ask for.
struct Ensemble {
  bool asked = false;  // --seeds is given
  std::vector<std::uint64_t> seeds;
  std::vector<int> sizes;  // empty: --particles
  // How many of the seeds each size takes, from the first.
  std::vector<std::size_t> seeds_of_size;
  int jobs = 1;
  bool resume = false;  // of a binary that has the flag
  // Every other flag that the user gave, as --name=value, for the children.
  std::vector<std::string> passed;

  // --particles if --sizes was not given.
  std::vector<int> Sizes() const;
  // A run for each size and seed: its flags, and how long it takes beside
  // others.
  struct Run {
    int particles = 0;
    std::uint64_t seed = 0;
    std::vector<std::string> arguments;
    double weight = 1.0;
  };
  std::vector<Run> Runs() const;
};

// Call it after ParseFlags() and before a flag is changed; BadInput for values
// that make no sense. Children do not get the flags `own` of the binary.
Ensemble ReadEnsembleFlags(const std::vector<std::string>& own = {});

// Of one packing, from the summary.json of its run.
struct Member {
  int particles = 0;
  std::uint64_t seed = 0;
  bool complete = false;   // the run has a result
  std::string failure;     // one line, if it has none or cannot be read
  bool converged = false;  // error bar as asked
  double phi_j = 0.0;
  double error = 0.0;
  double asked_error = 0.0;  // 0: none was
  int rigid_grains = 0;
  int excess_contacts = 0;
  int rattlers = 0;
  std::string certificate;  // the verdict; empty: none
  int cycles = 0;
  int relaxations = 0;
  std::int64_t evaluations = 0;
  double seconds = 0.0;
};

// Of the members of one size that have a result.
struct SizeStatistics {
  int particles = 0;
  int asked = 0, complete = 0, converged = 0, isostatic = 0, certified = 0;
  double mean = 0.0;               // of phi_J
  double deviation = 0.0;          // with n - 1; 0 for one
  double standard_error = 0.0;     // deviation / sqrt(n)
  double least = 0.0, most = 0.0;  // of phi_J
  double largest_error = 0.0;      // error bar
  double rattlers = 0.0;           // mean part of all grains
  double median_seconds = 0.0;
};
SizeStatistics Summarize(const std::vector<Member>& members, int particles);

// 1 / (d nu) of phi_J(N) = phi_inf - c N^(-1 / (d nu)), with 1 / nu = 1.41.
//
// Source: O'Hern, Silbert, Liu, Nagel, Phys. Rev. E 68 (2003) 011306: 1 / nu =
// 1 / 0.71, phi_inf = 0.8418 (discs), 0.648 (spheres, both bidisperse).
double FiniteSizeExponent(int dimension);

// a = phi_inf, b = -c, from the means and standard errors of sizes with at
// least two members; no fit with fewer than two such sizes.
LineFit FitFiniteSize(const std::vector<SizeStatistics>& sizes,
                      double exponent);

// particles,seed,phi_j,error,converged,rigid_grains,excess_contacts,rattlers,
// certificate,cycles,relaxations,evaluations,seconds
std::string EnsembleCsv(const std::vector<Member>& members);

// Runs a copy of this binary for each size and seed, at most --jobs at a time,
// in OUT/n<N>_seed<k>; with --resume only those that have no complete result
// for the same flags. Then writes and prints what they found. Returns the exit
// status: 0 if all converged, else 1.
int RunEnsemble(const Ensemble& ensemble, const ContactEnergyOptions& energy);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_ENSEMBLE_H_
