// granopt: weak forces and small gaps in the results of experiments.

#ifndef GRANOPT_EXPERIMENTS_DISTRIBUTIONS_H_
#define GRANOPT_EXPERIMENTS_DISTRIBUTIONS_H_

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/run.h"
#include "granular/distributions.h"

namespace granopt {

// What one packing contributes.
struct PackingSamples {
  int particles = 0;
  std::uint64_t seed = 0;
  JammingSamples samples;
};

// Gaps are collected and drawn up to this one.
constexpr double kMaxGap = 0.3;

// The fits to packings taken together, by ScanPowerLaw(): forces up to their
// mean at most, gaps up to 0.1 at most, windows of kLeastSamples samples at
// least. Each begins at N^(-1/s), N the grains of the smallest packing and s
// the theory's slope of the cumulative distribution: about the least of N
// samples, below which packings of N grains have too few (finite size:
// Charbonneau et al., Phys. Rev. E 104 (2021) 014102). Gaps begin at kBlur
// times the largest mean overlap, if that is more.
struct DistributionFits {
  PowerLawFit localized, extended, gaps;  // gaps: exponent = -gamma
  double blur = 0.0;                      // kBlur * mean overlap
  int packings = 0, bucklers = 0, rigid_grains = 0;
};
constexpr int kLeastSamples = 100;
DistributionFits FitDistributions(const std::vector<PackingSamples>& packings);

// {"theta_localized": {"exponent", "error", "samples", "low", "high",
// "ks_distance", "literature"}, "theta_extended": ..., "gamma": ...}; null
// where there is no fit.
Json FitsJson(const DistributionFits& fits);
// "theta_l = 0.19 +- 0.02 (421 forces), theta_e = ..., gamma = ...".
std::string FitsLine(const DistributionFits& fits);

// particles,seed,kind,force and particles,seed,gap, sorted by value.
std::string ForcesCsv(const std::vector<PackingSamples>& packings);
std::string GapsCsv(const std::vector<PackingSamples>& packings);
// particles,quantity,samples,blur,low,high,exponent,error,ks_distance,
// literature: a row for each fit; what is below `blur` is blurred.
std::string FitsCsvHeader();
std::string FitsCsvRows(int particles, const DistributionFits& fits);

// Names of what WriteDistributions() writes, for Output::Create().
std::vector<std::string> WithDistributionFiles(std::vector<std::string> names);

// forces.csv, gaps.csv, distributions.csv with `rows`, and the figure.
void WriteDistributions(const std::vector<PackingSamples>& packings,
                        const std::string& rows,
                        Output* output);

// For one jammed packing: writes them, adds "distributions" to `json`, returns
// the line "distributions theta_l = ..." of the report.
std::string PublishDistributions(const Packing& packing,
                                 const std::vector<Contact>& contacts,
                                 Output* output,
                                 Json* json);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_DISTRIBUTIONS_H_
