// granopt: a few numbers for many.

#ifndef GRANOPT_EXPERIMENTS_STATISTICS_H_
#define GRANOPT_EXPERIMENTS_STATISTICS_H_

#include <vector>

namespace granopt {

// Of values that may be infinite (a run that never got there): linear between
// neighbours, NaN without values. `part` in [0, 1].
double QuantileOf(std::vector<double> values, double part);
double MedianOf(std::vector<double> values);

struct Quantiles {
  double low = 0.0;     // 20 %
  double median = 0.0;  // 50 %
  double high = 0.0;    // 80 %
};
Quantiles QuantilesOf(std::vector<double> values);

struct MedianWorst {
  double median = 0.0, worst = 0.0;  // NaN without values
};
MedianWorst MedianAndWorst(const std::vector<double>& values);

// Of n finite values, with n - 1; NaN without values, no deviation of one. Sums
// are of differences from the first: values may be alike in many digits.
struct MeanDeviation {
  double mean = 0.0;
  double deviation = 0.0;
  double standard_error = 0.0;  // deviation / sqrt(n)
};
MeanDeviation MeanAndDeviation(const std::vector<double>& values);

// Half the width of the 95 % interval of a mean of n values, in standard errors
// (Student's t, to 1 % for n >= 5).
double ConfidenceFactor(int n);
// True if n values do not tell the mean of a difference from 0, on either side.
bool AreEqual(double difference, double error, int n);

// Wilson's 95 % interval of a probability of which `count` of `trials` were
// seen; (0, 1) without trials.
struct Interval {
  double low = 0.0, high = 1.0;
};
Interval Wilson(int count, int trials);

}  // namespace granopt

#endif  // GRANOPT_EXPERIMENTS_STATISTICS_H_
