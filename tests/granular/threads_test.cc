// Threads: no result depends on how many there are, bit for bit.

#include "solvers/threads.h"

#include <cstring>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "granular/neighbor_list.h"
#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "solvers/vector_loops.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

// So many while one of these lives.
class Threads {
 public:
  explicit Threads(int threads) { is_set_ = SetNumThreads(threads); }
  ~Threads() { SetNumThreads(1); }
  bool is_set() const { return is_set_; }

 private:
  bool is_set_;
};

constexpr int kCounts[] = {2, 3, 7};

bool CanHaveThreads() { return Threads(2).is_set(); }

TEST(Threads, CountsBelowOneAreRefused) {
  EXPECT_FALSE(SetNumThreads(0));
  EXPECT_FALSE(SetNumThreads(-2));
  EXPECT_EQ(NumThreads(), 1);
}

TEST(Threads, EveryIndexOnce) {
  for (const int threads : {1, 2, 7}) {
    Threads these(threads);
    if (!these.is_set()) GTEST_SKIP() << "built without OpenMP";
    for (const int count : {0, 1, 5, 100}) {
      std::vector<int> visits(count, 0);
      ForEach(count, [&](int k) { ++visits[k]; });
      EXPECT_EQ(visits, std::vector<int>(count, 1));
    }
  }
}

// A last piece of one entry included.
TEST(Threads, SumsOfVectorsHaveTheSameBits) {
  for (const int n : {kVectorPiece, kVectorPiece + 1, 5 * kVectorPiece - 3}) {
    Eigen::VectorXd a(n), b(n);
    long double exact = 0.0;
    for (int v = 0; v < n; ++v) {
      a[v] = std::sin(1.0 + 7.0 * v);
      b[v] = std::cos(2.0 + 3.0 * v);
      exact += static_cast<long double>(a[v]) * b[v];
    }
    const auto sums = [&]() {
      const double dot = Dot(n, a.data(), b.data());
      const auto dots = Dots(n, a.data(), b.data());
      Eigen::VectorXd s(n), y(n);
      const double combined =
          Combine(n, -0.5, a.data(), 0.1, b.data(), y.data(), a.data());
      const auto differences = Differences(
          n, a.data(), b.data(), a.data(), y.data(), s.data(), y.data());
      Move(n, 0.7, 0.2, a.data(), 0.3, s.data(), y.data());
      return std::make_tuple(
          dot, dots, combined, differences, MaxNorm(n, y.data()), s, y);
    };
    const auto serial = sums();
    EXPECT_NEAR(std::get<0>(serial), static_cast<double>(exact), n * kEps);
    EXPECT_EQ(std::get<1>(serial)[0], std::get<0>(serial));
    for (const int threads : kCounts) {
      Threads these(threads);
      EXPECT_EQ(sums(), serial) << threads << " threads, " << n;
    }
  }
}

bool SameBits(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * a.size()) == 0;
}

// In no spatial order, so that most pairs belong to two threads, and of several
// pieces, the last of which is short; with stiffnesses of its own. The energy
// is the sum of contacts and the gradient that of their forces.
TEST(Threads, EnergiesHaveTheSameBitsWithEveryListAndPrecision) {
  if (!CanHaveThreads()) GTEST_SKIP() << "built without OpenMP";
  for (const int d : {2, 3}) {
    for (const int n : {4096, 4097, 13000}) {
      Packing packing = RandomPacking(d, n, d == 2 ? 0.9 : 0.7, 5);
      packing.stiffness.resize(n);
      for (int i = 0; i < n; ++i) packing.stiffness[i] = 1.0 + (i % 7) / 8.0;
      for (const Precision precision : {Precision::DOUBLE, Precision::FLOAT}) {
        SCOPED_TRACE(testing::Message() << d << "D, N = " << n << ", "
                                        << PrecisionName(precision));
        ContactEnergyOptions options;
        options.alpha = 2.5;
        options.precision = precision;
        const auto energy = MakeEnergy(packing, options);
        std::vector<double> u(d * n), far(d * n);
        for (int v = 0; v < d * n; ++v) {
          u[v] = 0.003 * packing.MeanRadius() * std::sin(1.0 + 7.0 * v);
          far[v] = 60.0 * u[v];
        }
        const Evaluation near_serial = Evaluate(*energy, u);
        const Evaluation far_serial = Evaluate(*energy, far);
        if (precision == Precision::DOUBLE) {
          double sum = 0.0;
          std::vector<double> gradient(d * n, 0.0);
          for (const Contact& c : energy->Contacts(u.data())) {
            sum += c.force * c.overlap / options.alpha;
            for (int k = 0; k < d; ++k) {
              gradient[d * c.id.i + k] -= c.force * c.normal[k];
              gradient[d * c.id.j + k] += c.force * c.normal[k];
            }
          }
          EXPECT_NEAR(near_serial.energy, sum, 1e-12 * sum);
          for (int v = 0; v < d * n; ++v) {
            ASSERT_NEAR(near_serial.gradient[v],
                        gradient[v],
                        1e-13 * near_serial.scales.gradient);
          }
        }
        for (const int threads : kCounts) {
          Threads these(threads);
          SCOPED_TRACE(testing::Message() << threads << " threads");
          // Lists there and back are other ones; the first is one thread's own.
          ExpectIdentical(Evaluate(*energy, far), far_serial);
          ExpectIdentical(Evaluate(*energy, u), near_serial);
          ExpectIdentical(Evaluate(*MakeEnergy(packing, options), u),
                          near_serial);
          double value = 0.0;
          ASSERT_TRUE(
              energy->EvaluateWithScales(u.data(), &value, nullptr, nullptr));
          EXPECT_EQ(value, near_serial.energy);
        }
      }
    }
  }
}

// With recentring, rebasing and, in mixed precision, the change to double.
TEST(Threads, RunsOfMethodsHaveTheSameBits) {
  if (!CanHaveThreads()) GTEST_SKIP() << "built without OpenMP";
  Packing packing = RandomPacking(2, 13000, 0.95, 7);
  for (const char* method : {"fire", "lbfgs", "ncg"}) {
    for (const Precision precision : {Precision::DOUBLE, Precision::MIXED}) {
      SCOPED_TRACE(testing::Message()
                   << method << ", " << PrecisionName(precision));
      const auto run = [&]() {
        ContactEnergyOptions law;
        law.precision = precision;
        const auto energy = MakeEnergy(packing, law);
        std::string error;
        SolveOptions options;
        options.relative_tolerance = 1e-14;
        options.max_evaluations = 120;
        std::vector<double> u(energy->NumParameters(), 0.0);
        const Summary summary = CreateSolver(method, &error)
                                    ->Minimize(energy.get(), options, u.data());
        EXPECT_EQ(summary.reason, StopReason::MAX_EVALUATIONS);
        EXPECT_GT(summary.counters.recenters, 0);
        u.push_back(summary.cost);
        u.push_back(summary.max_gradient);
        return u;
      };
      const std::vector<double> serial = run();
      for (const int threads : {2, 3}) {
        Threads these(threads);
        EXPECT_TRUE(SameBits(run(), serial)) << threads << " threads";
      }
    }
  }
}

TEST(Threads, ListsOfNeighboursAreTheSame) {
  if (!CanHaveThreads()) GTEST_SKIP() << "built without OpenMP";
  const Packing packing = RandomPacking(3, 9000, 0.7, 3);
  const auto build = [&](double skin, NeighborList* list, std::string* error) {
    return BuildNeighborList(
        packing.box, packing.positions, packing.radii, skin, list, error);
  };
  NeighborList serial;
  std::string serial_error;
  ASSERT_TRUE(build(0.2 * packing.MeanRadius(), &serial, &serial_error));
  // The cell is far too small: the first grain is named.
  const double huge = 100.0 * packing.box.Height(0);
  NeighborList refused;
  ASSERT_FALSE(build(huge, &refused, &serial_error));
  for (const int threads : kCounts) {
    Threads these(threads);
    NeighborList list;
    std::string error;
    ASSERT_TRUE(build(0.2 * packing.MeanRadius(), &list, &error));
    EXPECT_EQ(list.row_start, serial.row_start);
    EXPECT_EQ(list.i, serial.i);
    EXPECT_EQ(list.j, serial.j);
    EXPECT_EQ(list.image, serial.image);
    EXPECT_FALSE(build(huge, &refused, &error));
    EXPECT_EQ(error, serial_error);
  }
}

}  // namespace
}  // namespace granopt
