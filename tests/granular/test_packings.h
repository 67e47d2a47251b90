// granopt: packings and oracles that the tests of granular/ share.

#ifndef GRANOPT_TESTS_GRANULAR_TEST_PACKINGS_H_
#define GRANOPT_TESTS_GRANULAR_TEST_PACKINGS_H_

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "granular/contact_energy.h"
#include "granular/observables.h"
#include "granular/packing.h"
#include "granular/packing_generator.h"
#include "granular/packing_io.h"
#include "granular/quad_residual.h"
#include "gtest/gtest.h"
#include "solvers/random.h"
#include "solvers/registry.h"

namespace granopt {

using Quad = __float128;

constexpr double kEps = std::numeric_limits<double>::epsilon();

// ---- packings

inline Packing ReadData(const std::string& name) {
  Packing packing;
  std::string error;
  EXPECT_TRUE(ReadPacking(
      std::string(GRANOPT_TEST_DATA) + "/" + name, &packing, &error))
      << error;
  return packing;
}

inline SmallMatrix Matrix2(double a, double b, double c, double d) {
  SmallMatrix m(2, 2);
  m << a, b, c, d;
  return m;
}

inline SmallVector Vector2(double x, double y) {
  SmallVector v(2);
  v << x, y;
  return v;
}

// The packing of a file of tests/data in simple shear.
inline Packing Sheared(const char* file, double shear) {
  Packing packing = ReadData(file);
  packing.Deform(SimpleShear(packing.dimension(), shear));
  return packing;
}

// Grains at the columns of `positions`.
inline Packing MakePacking(const Box& box,
                           const Eigen::MatrixXd& positions,
                           const std::vector<double>& radii) {
  Packing packing;
  packing.box = box;
  packing.positions = positions;
  packing.radii = Eigen::Map<const Eigen::VectorXd>(radii.data(), radii.size());
  return packing;
}

// Uniform random centres, radii 1 and 1.4, in the unit cell deformed by D.
inline Packing RandomPacking(int dimension,
                             int particles,
                             double phi,
                             std::uint64_t seed,
                             const SmallMatrix& deformation) {
  GeneratorOptions options;
  options.dimension = dimension;
  options.particles = particles;
  options.packing_fraction = phi;
  options.seed = seed;
  Packing packing;
  std::string error;
  EXPECT_TRUE(GeneratePacking(options, &packing, &error)) << error;
  packing.Deform(deformation);
  return packing;
}

inline Packing RandomPacking(int dimension,
                             int particles,
                             double phi,
                             std::uint64_t seed) {
  return RandomPacking(dimension,
                       particles,
                       phi,
                       seed,
                       SmallMatrix::Identity(dimension, dimension));
}

// The packing with lengths times 2^b.
inline Packing WithLengths(int b, const Packing& packing) {
  const double length = std::ldexp(1.0, b);
  Packing scaled = packing;
  scaled.box = Box(SmallMatrix(length * packing.box.edges()));
  scaled.positions *= length;
  scaled.positions_low *= length;
  scaled.radii *= length;
  return scaled;
}

// 40 grains in a sheared cell, with stiffnesses of their own.
inline Packing MixedPacking(int d, std::uint64_t seed) {
  Packing packing = RandomPacking(d, 40, 0.95, seed, SimpleShear(d, 0.3));
  packing.stiffness.resize(packing.size());
  UniformRandom random(seed);
  for (int i = 0; i < packing.size(); ++i) {
    packing.stiffness[i] = 0.5 + random();
  }
  return packing;
}

// One grain at each point P m of a lattice, m_k = 0 ... repeat_k - 1, in the
// cell P diag(repeat).
inline Packing BravaisLattice(const SmallMatrix& primitive,
                              const std::vector<int>& repeat,
                              double radius) {
  const int d = static_cast<int>(primitive.rows());
  int n = 1;
  SmallMatrix edges = primitive;
  for (int k = 0; k < d; ++k) {
    n *= repeat[k];
    edges.col(k) *= repeat[k];
  }
  Packing packing;
  packing.box = Box(edges);
  packing.positions.setZero(d, n);
  packing.radii.setConstant(n, radius);
  for (int i = 0; i < n; ++i) {
    int rest = i;
    for (int k = 0; k < d; ++k) {
      packing.positions.col(i) += (rest % repeat[k]) * primitive.col(k);
      rest /= repeat[k];
    }
  }
  return packing;
}

// Neighbours at distance a: six of them, three contacts a grain.
inline SmallMatrix HexagonalCell(double a) {
  return Matrix2(a, 0.5 * a, 0.0, std::sqrt(3.0) / 2.0 * a);
}

// Neighbours at distance a: twelve of them, six contacts a grain.
inline SmallMatrix FccCell(double a) {
  SmallMatrix p(3, 3);
  p << 0, 1, 1, 1, 0, 1, 1, 1, 0;
  return a / std::sqrt(2.0) * p;
}

// A cell with random edges, not too flat: |det| > 0.15 edge lengths' product.
inline Box RandomBox(int dimension, std::uint64_t seed) {
  UniformRandom random(seed);
  while (true) {
    SmallMatrix edges(dimension, dimension);
    double product = 1.0;
    for (int c = 0; c < dimension; ++c) {
      for (int r = 0; r < dimension; ++r) edges(r, c) = 2.0 * random() - 1.0;
      product *= edges.col(c).norm();
    }
    const Box box(edges);
    if (box.Volume() > 0.15 * product) return box;
  }
}

// ---- evaluation

inline std::vector<double> RandomVector(int n,
                                        double amplitude,
                                        std::uint64_t seed) {
  UniformRandom random(seed);
  std::vector<double> v(n);
  for (double& x : v) x = amplitude * (2.0 * random() - 1.0);
  return v;
}

// Never null.
inline std::unique_ptr<ContactEnergy> MakeEnergy(
    const Packing& packing, const ContactEnergyOptions& options) {
  std::string error;
  std::unique_ptr<ContactEnergy> energy =
      ContactEnergy::Create(packing, options, &error);
  // Ends the test, not the tests.
  if (energy == nullptr) throw std::runtime_error(error);
  return energy;
}

inline std::unique_ptr<ContactEnergy> MakeEnergy(const Packing& packing,
                                                 double alpha) {
  ContactEnergyOptions options;
  options.alpha = alpha;
  return MakeEnergy(packing, options);
}

inline std::unique_ptr<Solver> MakeSolver(const std::string& spec) {
  std::string error;
  std::unique_ptr<Solver> solver = CreateSolver(spec, &error);
  EXPECT_NE(solver, nullptr) << error;
  return solver;
}

inline std::vector<double> Zero(const FirstOrderFunction& function) {
  return std::vector<double>(function.NumParameters(), 0.0);
}

struct Evaluation {
  bool ok = false;
  double energy = 0.0;
  std::vector<double> gradient;
  Scales scales;
};

inline Evaluation Evaluate(const ContactEnergy& energy,
                           const std::vector<double>& u) {
  Evaluation result;
  result.gradient.resize(energy.NumParameters());
  result.ok = energy.EvaluateWithScales(
      u.data(), &result.energy, result.gradient.data(), &result.scales);
  return result;
}

inline Evaluation Evaluate(const ContactEnergy& energy) {
  return Evaluate(energy, Zero(energy));
}

inline Observables MeasureAtRest(const Packing& packing, double alpha) {
  const auto energy = MakeEnergy(packing, alpha);
  return Measure(packing,
                 energy->Contacts(Zero(*energy).data()),
                 Evaluate(*energy).energy);
}

// The same bits throughout.
inline void ExpectIdentical(const Evaluation& a, const Evaluation& b) {
  EXPECT_EQ(a.ok, b.ok);
  EXPECT_EQ(a.energy, b.energy);
  EXPECT_EQ(a.gradient, b.gradient);
  EXPECT_EQ(a.scales.gradient, b.scales.gradient);
  EXPECT_EQ(a.scales.length, b.scales.length);
  EXPECT_EQ(a.scales.vanishing, b.scales.vanishing);
}

inline double MaxAbs(const std::vector<double>& v) {
  double most = 0.0;
  for (const double x : v) {
    if (!(std::abs(x) <= most)) most = std::abs(x);
  }
  return most;
}

inline double MaxDifference(const std::vector<double>& a,
                            const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  std::vector<double> difference(a.size());
  for (std::size_t k = 0; k < a.size(); ++k) difference[k] = a[k] - b[k];
  return MaxAbs(difference);
}

// f'(0) of a function of one variable from values at +-h and +-2h:
// error h^4 f^(5) / 30, roundoff about 1.5 eps f / h.
template <typename Function>
double Derivative(const Function& f, double h) {
  return (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h);
}

// f''(0), same points: error h^4 f^(6) / 90, roundoff about 5 eps f / h^2.
template <typename Function>
double SecondDerivative(const Function& f, double h) {
  return (16.0 * (f(h) + f(-h)) - (f(2.0 * h) + f(-2.0 * h)) - 30.0 * f(0.0)) /
         (12.0 * h * h);
}

// ---- oracle

struct ImagePair {
  GapId id;
  long double distance;
};

// Every pair (i, j, image) with distance |x_i - x_j + H image| < range(i, j),
// once, sorted, by running over all grains and over all images that the extent
// of the cell's inverse allows: no grid, no reduction, no double rounding.
template <typename Range>
std::vector<ImagePair> AllImagePairs(const Box& box,
                                     const Eigen::MatrixXd& positions,
                                     const Range& range) {
  using Real = long double;
  const int d = box.dimension();
  const int n = static_cast<int>(positions.cols());
  Real h[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int r = 0; r < d; ++r) {
    for (int c = 0; c < d; ++c) h[r][c] = box.edges()(r, c);
  }
  Real inverse[3][3], determinant = 0;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {  // cofactors, cyclic indices
      inverse[c][r] =
          h[(r + 1) % 3][(c + 1) % 3] * h[(r + 2) % 3][(c + 2) % 3] -
          h[(r + 1) % 3][(c + 2) % 3] * h[(r + 2) % 3][(c + 1) % 3];
    }
  }
  for (int c = 0; c < 3; ++c) determinant += h[0][c] * inverse[c][0];
  std::vector<ImagePair> pairs;
  for (int i = 0; i < n; ++i) {
    for (int j = i; j < n; ++j) {
      const Real cutoff = range(i, j);
      Real r[3] = {0, 0, 0};
      for (int k = 0; k < d; ++k) {
        r[k] = Real(positions(k, i)) - Real(positions(k, j));
      }
      // |f_k + n_k| <= cutoff |row k of H^-1| with f = H^-1 r.
      int low[3] = {0, 0, 0}, high[3] = {0, 0, 0};
      for (int k = 0; k < d; ++k) {
        Real f = 0, norm2 = 0;
        for (int c = 0; c < d; ++c) {
          f += inverse[k][c] / determinant * r[c];
          norm2 += inverse[k][c] * inverse[k][c] / (determinant * determinant);
        }
        const Real reach = cutoff * std::sqrt(norm2);
        low[k] = static_cast<int>(std::floor(-f - reach));
        high[k] = static_cast<int>(std::ceil(-f + reach));
      }
      Image m;
      for (m[0] = low[0]; m[0] <= high[0]; ++m[0]) {
        for (m[1] = low[1]; m[1] <= high[1]; ++m[1]) {
          for (m[2] = low[2]; m[2] <= high[2]; ++m[2]) {
            if (i == j && !(m > Image{0, 0, 0})) continue;
            Real square = 0;
            for (int k = 0; k < d; ++k) {
              Real x = r[k];
              for (int c = 0; c < d; ++c) x += h[k][c] * m[c];
              square += x * x;
            }
            const Real distance = std::sqrt(square);
            if (distance < cutoff) pairs.push_back({{i, j, m}, distance});
          }
        }
      }
    }
  }
  return pairs;
}

inline QuadResidual InQuad(const Packing& packing,
                           const ContactEnergyOptions& options,
                           const std::vector<double>& u) {
  QuadResidual result;
  std::string error;
  EXPECT_TRUE(EvaluateQuad(packing, options, u.data(), &result, &error))
      << error;
  return result;
}

// The greatest difference of a gradient entry, over the mean force.
inline double ForceError(const Evaluation& e, const QuadResidual& quad) {
  return MaxDifference(e.gradient, quad.gradient) / quad.mean_force;
}

// True if, at u, no overlap is closer to zero than `clearance` and no pair's
// centres are closer than 20 clearances: finite differences with steps far
// below then see a smooth function.
inline bool IsSmooth(const ContactEnergy& energy,
                     const std::vector<double>& u,
                     double clearance) {
  Gaps gaps;
  if (!energy.EvaluateGaps(u.data(), &gaps)) return false;
  for (int c = 0; c < gaps.delta.size(); ++c) {
    if (std::abs(gaps.delta[c]) < clearance) return false;
  }
  for (const Contact& c : energy.Contacts(u.data())) {
    if (c.distance < 20.0 * clearance) return false;
  }
  return true;
}

}  // namespace granopt

#endif  // GRANOPT_TESTS_GRANULAR_TEST_PACKINGS_H_
