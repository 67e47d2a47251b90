// granopt: normal modes of vibration of a packing.

#ifndef GRANOPT_GRANULAR_VIBRATIONS_H_
#define GRANOPT_GRANULAR_VIBRATIONS_H_

#include <string>
#include <vector>

#include "granular/contact_energy.h"

namespace granopt {

struct VibrationOptions {
  // Up to so many grains that count every mode is computed, by a dense method:
  // (d N')^2 numbers and some (d N')^3 operations.
  int most_dense = 1024;
  // With more grains, so many of the lowest modes.
  int lowest = 100;
};

// A mode of the grains that count (force_network.h), H e = lambda e with |e| =
// 1. With masses 1 its frequency is omega = sqrt(lambda).
struct Vibration {
  // sqrt(lambda / kappa); minus sqrt(-lambda / kappa) where lambda < 0.
  double frequency = 0.0;
  // (sum |e_i|^2)^2 / (N' sum |e_i|^4): 1 / N' on one grain, 1 on all alike.
  double participation = 0.0;
};

struct Vibrations {
  bool found = false;
  std::string message;     // one line if nothing was found
  bool complete = false;   // all d N' - d modes but translations
  int grains = 0;          // N'
  double stiffness = 0.0;  // kappa = (alpha - 1) mean force / mean overlap
  std::vector<Vibration> modes;  // in increasing order, without translations
};

// The modes of a packing at a minimum of its energy. Frequencies are in
// units of sqrt(kappa / m), in which their distribution does not depend on the
// distance from jamming but for its lower end.
//
// Deviations: usual plots for alpha = 2 have sqrt(k / m), which is the same.
Vibrations ComputeVibrations(const Packing& packing,
                             const ContactEnergyOptions& law,
                             const VibrationOptions& options);

// The density of the frequencies of complete spectra: `counts[b]` of those in
// [edges[b], edges[b + 1]) over all modes and the width of the bin.
struct DensityOfStates {
  std::vector<double> edges, density;
  std::vector<double> participation;  // mean of the bin; 0 without modes
  std::vector<int> counts;
};
DensityOfStates BinModes(const std::vector<Vibration>& modes,
                         const std::vector<double>& edges);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_VIBRATIONS_H_
