// granopt: the weak forces and small gaps of packings at jamming.

#ifndef GRANOPT_GRANULAR_DISTRIBUTIONS_H_
#define GRANOPT_GRANULAR_DISTRIBUTIONS_H_

#include <string>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/packing.h"

namespace granopt {

// Mean-field exponents of jamming, to five digits: the densities of
//   weak forces of bucklers        P(f) ~ f^theta_l,
//   weak forces of all others      P(f) ~ f^theta_e,
//   gaps of grains nearly touching P(h) ~ h^-gamma,
// related by gamma = 1 / (2 + theta_e) = (1 - theta_l) / 2.
//
// Source: Charbonneau, Kurchan, Parisi, Urbani, Zamponi, Nat. Commun. 5 (2014)
// 3725; the relations: Wyart, Phys. Rev. Lett. 109 (2012) 125502; Lerner,
// During, Wyart, Soft Matter 9 (2013) 8252.
constexpr double kThetaLocalized = 0.17462;
constexpr double kThetaExtended = 0.42311;
constexpr double kGamma = 0.41269;

// What one jammed packing contributes to them. Forces are those of contacts
// between two rigid grains (observables.h), in units of their mean <f>; a
// buckler is a rigid grain with exactly d + 1 contacts, whose weakest one can
// be opened by a motion of that grain alone. Gaps
//   h = (|x_i - x_j| - r_i - r_j) / (r_i + r_j) > 0
// are those of two rigid grains, up to `max_gap`.
//
// Source: Charbonneau, Corwin, Parisi, Zamponi, Phys. Rev. Lett. 114 (2015)
// 125504.
struct JammingSamples {
  std::vector<double> localized;  // f / <f>, of contacts with a buckler
  std::vector<double> extended;   // f / <f>, of all others
  std::vector<double> gaps;       // h
  int rigid_grains = 0;
  int bucklers = 0;
  // Contacts beyond d N' - d + 1. A packing at a distance from jamming has
  // closed its smallest gaps; only with 0 are its forces, to first order, those
  // of the jamming point. Negative: held by too few, as by a residual.
  int excess_contacts = 0;
  // <delta / (r_i + r_j)>, which is of the order of the distance to jamming.
  double mean_overlap = 0.0;
};

// Gaps below this many mean overlaps are not counted: a gap of the jamming
// point differs from that of the packing by what its grains moved since, some
// ten mean overlaps (soft modes), so that those gaps are blurred.
constexpr double kBlur = 100.0;

// Samples of `packing` with its `contacts`. Separations are evaluated in
// double-double. Returns false with one line in `error` for a max_gap that is
// not positive, or where the neighbour search is refused. Not an error: a
// packing without rigid grains, which has no samples.
bool CollectSamples(const Packing& packing,
                    const std::vector<Contact>& contacts,
                    double max_gap,
                    JammingSamples* samples,
                    std::string* error);

// A density proportional to x^exponent on [low, high].
struct PowerLawFit {
  double exponent = 0.0;
  double error = 0.0;  // standard, of the exponent, for the window as it is
  int n = 0;           // samples in the window; 0: there is no fit
  double low = 0.0, high = 0.0;
  double distance = 0.0;  // of Kolmogorov and Smirnov: max |F_n - F|
};

// Maximum likelihood on a given window, 0 <= low < high. With low = 0,
//   exponent = n / sum ln(high / x_i) - 1,  error = (1 + exponent) / sqrt(n).
// With low > 0, s = 1 + exponent solves
//   L / (1 - e^(-s L)) - 1 / s = mean ln(x_i / low),  L = ln(high / low),
// and error = (n I)^(-1/2) with the Fisher information
//   I = 1 / s^2 - L^2 e^(s L) / (e^(s L) - 1)^2.
// Samples need not be sorted; those outside of the window (and, if low = 0,
// zeros) are left out. Fewer than two, or all at one end: n = 0.
//
// Source: Clauset, Shalizi, Newman, SIAM Rev. 51 (2009) 661, appendix B,
// mirrored: their power law is a tail, these end at zero.
PowerLawFit FitPowerLaw(const std::vector<double>& samples,
                        double low,
                        double high);

// The same on the window [low, x] with the x <= most for which the
// Kolmogorov-Smirnov distance is least, out of 60 spaced evenly in the
// logarithm of the number of samples, from `least` samples on. With fewer
// samples than `least` below `most`: the window [low, most].
//
// Source: the same, sec. 3.3. Deviations: what the choice of the window adds to
// the uncertainty is not part of `error`.
PowerLawFit ScanPowerLaw(std::vector<double> samples,
                         double low,
                         double most,
                         int least);

// y = a + b x with independent normal errors of y.
struct LineFit {
  double a = 0.0, b = 0.0;
  double a_error = 0.0, b_error = 0.0;
  double chi2 = 0.0;  // of n - 2 degrees of freedom
  int n = 0;          // 0: there is no fit
};

// Weighted least squares; errors follow from `error` alone and are not rescaled
// by chi2. No fit with fewer than two different x, or an error that is not
// positive.
LineFit FitLine(const std::vector<double>& x,
                const std::vector<double>& y,
                const std::vector<double>& error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_DISTRIBUTIONS_H_
