#include "granular/pair_loops.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "granular/neighbor_list.h"
#include "gtest/gtest.h"
#include "solvers/instruction_set.h"
#include "solvers/power_of_two.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

struct NamedLoops {
  std::string name;
  PairLoops loops;
};

// Of the instruction sets that this machine has.
std::vector<NamedLoops> Runnable(int dimension, double alpha) {
  std::vector<NamedLoops> all = {
      {"portable", PortablePairLoops(dimension, alpha)}};
#ifdef __x86_64__
  if (Runs(InstructionSet::AVX2)) {
    all.push_back({"AVX2", Avx2PairLoops(dimension, alpha)});
  }
  if (Runs(InstructionSet::AVX512)) {
    all.push_back({"AVX-512", Avx512PairLoops(dimension, alpha)});
  }
#endif
  return all;
}

// The arrays behind a PairView, in plain doubles.
struct Pairs {
  PairView view;
  std::vector<int> i, j, at_i, at_j;
  std::vector<double> r0[3], d0, delta0, stiffness;
  std::vector<float> single_r0[3], single_d0, single_delta0;
};

// Of every pair nearer than `skin` mean radii; `stiff` gives each its own k.
void MakePairs(const Packing& packing, double skin, bool stiff, Pairs* pairs) {
  NeighborList list;
  std::string error;
  ASSERT_TRUE(BuildNeighborList(packing.box,
                                packing.positions,
                                packing.radii,
                                skin * packing.MeanRadius(),
                                &list,
                                &error))
      << error;
  const int d = packing.dimension();
  const int m = list.num_pairs();
  pairs->i = list.i;
  pairs->j = list.j;
  pairs->at_i.assign(m + kPairPadding, 0);
  pairs->at_j.assign(m + kPairPadding, 0);
  pairs->d0.assign(m + kPairPadding, 1.0);
  pairs->delta0.assign(m + kPairPadding, -1.0);
  pairs->stiffness.assign(m + kPairPadding, 1.0);
  for (int c = 0; c < d; ++c) pairs->r0[c].assign(m + kPairPadding, 1.0);
  for (int p = 0; p < m; ++p) {
    const int i = list.i[p], j = list.j[p];
    pairs->at_i[p] = d * i;
    pairs->at_j[p] = d * j;
    Eigen::VectorXd r = packing.positions.col(i) - packing.positions.col(j);
    for (int c = 0; c < d; ++c) {
      r += packing.box.edges().col(c) * list.image[p][c];
    }
    for (int c = 0; c < d; ++c) pairs->r0[c][p] = r[c];
    pairs->d0[p] = std::max(r.norm(), std::numeric_limits<double>::min());
    pairs->delta0[p] = packing.radii[i] + packing.radii[j] - pairs->d0[p];
    // A function of the pair, not of its place in the list.
    pairs->stiffness[p] = 1.0 + 0.25 * ((7 * i + 3 * j) % 5);
    pairs->view.is_guarded = pairs->view.is_guarded || i == j;
  }
  pairs->view.end_grain = packing.size();
  pairs->view.num_pairs = m;
  pairs->view.at_i = pairs->at_i.data();
  pairs->view.at_j = pairs->at_j.data();
  for (int c = 0; c < d; ++c) pairs->view.r0[c] = pairs->r0[c].data();
  pairs->view.d0 = pairs->d0.data();
  pairs->view.delta0 = pairs->delta0.data();
  pairs->view.stiffness = stiff ? pairs->stiffness.data() : nullptr;
  SinglePairs& single = pairs->view.single;
  single.unit = PowerOfTwo(packing.MeanRadius());
  const auto round = [&](const std::vector<double>& from,
                         std::vector<float>* to) {
    for (const double v : from) {
      to->push_back(static_cast<float>(v / single.unit));
    }
    return to->data();
  };
  for (int c = 0; c < d; ++c) {
    single.r0[c] = round(pairs->r0[c], &pairs->single_r0[c]);
  }
  single.d0 = round(pairs->d0, &pairs->single_d0);
  single.delta0 = round(pairs->delta0, &pairs->single_delta0);
}

struct Values {
  ContactSums sums;
  std::vector<double> gradient;
};

using SweepOf = PairSweep PairLoops::*;

Values Evaluate(const PairLoops& loops,
                SweepOf sweep,
                const Pairs& pairs,
                double alpha,
                const std::vector<double>& w) {
  std::vector<float> single_w(w.size());
  loops.narrow(static_cast<int>(w.size()),
               1.0 / pairs.view.single.unit,
               w.data(),
               single_w.data());
  PairView view = pairs.view;
  view.single.w = single_w.data();
  Values values;
  values.gradient.assign(w.size(), 0.0);
  values.sums = (loops.*sweep)(view, alpha, w.data(), values.gradient.data());
  const ContactSums alone = (loops.*sweep)(view, alpha, w.data(), nullptr);
  EXPECT_EQ(alone.energy, values.sums.energy) << "without a gradient";
  return values;
}

void ExpectSameBits(const Values& a, const Values& b) {
  EXPECT_EQ(a.sums.energy, b.sums.energy);
  EXPECT_EQ(a.sums.force, b.sums.force);
  EXPECT_EQ(a.sums.overlap, b.sums.overlap);
  EXPECT_EQ(a.sums.virial, b.sums.virial);
  EXPECT_EQ(a.sums.contacts, b.sums.contacts);
  EXPECT_EQ(a.gradient, b.gradient);
}

// Long double, pair by pair, as written in (4)-(8).
void ExpectDefinition(const Values& values,
                      const Pairs& pairs,
                      int d,
                      double alpha,
                      const std::vector<double>& w) {
  long double energy = 0, force_sum = 0, overlap = 0, virial = 0;
  std::int64_t contacts = 0;
  std::vector<long double> gradient(w.size(), 0);
  for (int p = 0; p < pairs.view.num_pairs; ++p) {
    const int i = pairs.i[p], j = pairs.j[p];
    long double r[3] = {}, r2 = 0, r02 = 0;
    for (int c = 0; c < d; ++c) {
      r[c] = static_cast<long double>(pairs.r0[c][p]) + w[d * i + c] -
             w[d * j + c];
      r2 += r[c] * r[c];
      r02 += static_cast<long double>(pairs.r0[c][p]) * pairs.r0[c][p];
    }
    const long double l = std::sqrt(r2);
    const long double delta = pairs.delta0[p] - (l - std::sqrt(r02));
    if (!(delta > 0)) continue;
    ++contacts;
    const long double k =
        pairs.view.stiffness == nullptr ? 1.0 : pairs.stiffness[p];
    const long double f =
        k * std::pow(delta, static_cast<long double>(alpha) - 1);
    energy += k * std::pow(delta, static_cast<long double>(alpha)) / alpha;
    force_sum += f;
    overlap += delta;
    virial += f * l;
    for (int c = 0; c < d && l > 0; ++c) {
      gradient[d * i + c] -= f * r[c] / l;
      gradient[d * j + c] += f * r[c] / l;
    }
  }
  const auto near = [](double value, long double exact, const char* what) {
    EXPECT_NEAR(value, static_cast<double>(exact), 1e-13 * std::abs(exact))
        << what;
  };
  near(values.sums.energy, energy, "energy");
  near(values.sums.force, force_sum, "force");
  near(values.sums.overlap, overlap, "overlap");
  near(values.sums.virial, virial, "virial");
  EXPECT_EQ(values.sums.contacts, contacts);
  const long double unit = force_sum / contacts;
  for (std::size_t v = 0; v < w.size(); ++v) {
    EXPECT_NEAR(values.gradient[v],
                static_cast<double>(gradient[v]),
                static_cast<double>(1e-13L * unit));
  }
}

// Forces on some grains are theirs and touch no other; a view that ends within
// a register has its own contacts only.
void ExpectParts(const Values& all,
                 const PairLoops& loops,
                 SweepOf sweep,
                 const Pairs& pairs,
                 int d,
                 double alpha,
                 const std::vector<double>& w) {
  const int n = pairs.view.end_grain;
  const int m = pairs.view.num_pairs;
  for (const int cut : {1, n / 2}) {
    for (const bool second : {false, true}) {
      Pairs half = pairs;
      half.view.is_guarded = true;
      half.view.first_grain = second ? cut : 0;
      half.view.end_grain = second ? n : cut;
      const Values values = Evaluate(loops, sweep, half, alpha, w);
      for (std::size_t v = 0; v < w.size(); ++v) {
        const bool is_its_own = second == (static_cast<int>(v) >= d * cut);
        EXPECT_EQ(values.gradient[v], is_its_own ? all.gradient[v] : 0.0);
      }
    }
  }
  // Lanes beyond the last pair of a view are pairs of the next one.
  std::int64_t contacts = 0;
  double overlap = 0.0;
  const int step = m / 3 + 1;
  for (int first = 0; first < m; first += step) {
    Pairs some = pairs;
    PairView& view = some.view;
    view.num_pairs = std::min(step, m - first);
    view.at_i += first;
    view.at_j += first;
    view.d0 += first;
    view.delta0 += first;
    view.single.d0 += first;
    view.single.delta0 += first;
    for (int c = 0; c < d; ++c) {
      view.r0[c] += first;
      view.single.r0[c] += first;
    }
    if (view.stiffness != nullptr) view.stiffness += first;
    const Values values = Evaluate(loops, sweep, some, alpha, w);
    contacts += values.sums.contacts;
    overlap += values.sums.overlap;
  }
  EXPECT_EQ(contacts, all.sums.contacts);
  EXPECT_NEAR(overlap, all.sums.overlap, 1e-13 * overlap);
}

TEST(PairLoops, EveryInstructionSetHasTheSameBitsAndTheDefinition) {
  // 3 grains: a cell that they touch themselves across. Others are no multiples
  // of a register or a block.
  for (const int d : {2, 3}) {
    for (const int n : {3, 61, 500}) {
      const Packing packing = RandomPacking(d, n, n == 3 ? 3.9 : 0.95, 3 + n);
      std::vector<double> w(d * n);
      for (std::size_t v = 0; v < w.size(); ++v) {
        w[v] = 0.01 * packing.MeanRadius() * std::sin(1.0 + 7.0 * v);
      }
      for (const double alpha : {2.0, 2.5, 3.3}) {
        for (const bool stiff : {false, true}) {
          SCOPED_TRACE(testing::Message()
                       << d << "D, " << n << " grains, alpha " << alpha
                       << ", stiff " << stiff);
          Pairs tight, wide;
          MakePairs(packing, 0.1, stiff, &tight);
          MakePairs(packing, 0.6, stiff, &wide);
          EXPECT_GT(wide.view.num_pairs, tight.view.num_pairs);
          EXPECT_EQ(tight.view.is_guarded, n == 3);
          const auto all = Runnable(d, alpha);
          for (const SweepOf sweep :
               {&PairLoops::sweep, &PairLoops::single_sweep}) {
            const Values first = Evaluate(all[0].loops, sweep, tight, alpha, w);
            if (sweep == &PairLoops::sweep) {
              ExpectDefinition(first, tight, d, alpha, w);
            }
            for (const NamedLoops& set : all) {
              SCOPED_TRACE(set.name);
              ExpectSameBits(first,
                             Evaluate(set.loops, sweep, tight, alpha, w));
              // Open gaps do not count.
              ExpectSameBits(first, Evaluate(set.loops, sweep, wide, alpha, w));
              ExpectParts(first, set.loops, sweep, wide, d, alpha, w);
            }
          }
        }
      }
    }
  }
}

// delta, distance, normals, force and stiffness one after the other.
std::vector<double> States(const PairLoops& loops,
                           const Pairs& pairs,
                           int d,
                           double alpha,
                           const std::vector<double>& w) {
  const std::size_t m = pairs.view.num_pairs + kPairPadding;
  std::vector<std::vector<double>> arrays(4 + d,
                                          std::vector<double>(m, std::nan("")));
  PairStates states;
  states.delta = arrays[0].data();
  states.distance = arrays[1].data();
  states.force = arrays[2].data();
  states.stiffness = arrays[3].data();
  for (int c = 0; c < d; ++c) states.normal[c] = arrays[4 + c].data();
  loops.states(pairs.view, alpha, w.data(), states);
  std::vector<double> all;
  for (const std::vector<double>& array : arrays) {
    all.insert(all.end(), array.begin(), array.end() - kPairPadding);
  }
  return all;
}

TEST(PairLoops, StatesAndLawsHaveTheSameBitsAndMakeUpTheSums) {
  for (const int d : {2, 3}) {
    const Packing packing = RandomPacking(d, 61, 0.95, 5);
    const std::vector<double> w(d * 61, 0.0);
    for (const double alpha : {2.0, 2.5, 3.3}) {
      for (const bool stiff : {false, true}) {
        Pairs pairs;
        MakePairs(packing, 0.6, stiff, &pairs);
        const auto all = Runnable(d, alpha);
        const std::vector<double> first =
            States(all[0].loops, pairs, d, alpha, w);
        const std::size_t m = pairs.view.num_pairs;
        double force = 0.0, overlap = 0.0;
        for (std::size_t p = 0; p < m; ++p) {
          overlap += std::max(0.0, first[p]);
          force += first[2 * m + p];
          double norm2 = 0.0;
          for (int c = 0; c < d; ++c) {
            norm2 += first[(4 + c) * m + p] * first[(4 + c) * m + p];
          }
          EXPECT_NEAR(norm2, 1.0, 1e-14);
        }
        const Values sums =
            Evaluate(all[0].loops, &PairLoops::sweep, pairs, alpha, w);
        EXPECT_NEAR(force, sums.sums.force, 1e-13 * force);
        EXPECT_NEAR(overlap, sums.sums.overlap, 1e-13 * overlap);
        const std::vector<double> delta = {0.0, 0.01, 0.3};
        std::vector<double> f(3), k(3), f_first(3), k_first(3);
        all[0].loops.law(
            alpha, 3, delta.data(), f_first.data(), k_first.data());
        for (const NamedLoops& set : all) {
          SCOPED_TRACE(set.name);
          EXPECT_EQ(States(set.loops, pairs, d, alpha, w), first);
          set.loops.law(alpha, 3, delta.data(), f.data(), k.data());
          EXPECT_EQ(f, f_first);
          EXPECT_EQ(k, k_first);
        }
      }
    }
  }
}

// Each pair has a block, images of one grain the same one, but for one pair in
// seven, which has none.
struct Pattern {
  Pattern(const Pairs& pairs, int d, int n) : rank(pairs.view.num_pairs) {
    column_start.assign(d * n + 1, 0);
    int p = 0;
    for (int i = 0; i < n; ++i) {
      int blocks = 0, previous = i;
      for (; p < pairs.view.num_pairs && pairs.i[p] == i; ++p) {
        rank[p] = -1;
        if (pairs.j[p] == i || (n > 3 && p % 7 == 0)) continue;
        view.has_shared_blocks |= pairs.j[p] == previous;
        blocks += pairs.j[p] == previous ? 0 : 1;
        previous = pairs.j[p];
        rank[p] = blocks - 1;
      }
      for (int c = 0; c < d; ++c) {
        column_start[d * i + c + 1] =
            column_start[d * i + c] + (d - c) + d * blocks;
      }
    }
    view.rank = rank.data();
    view.column_start = column_start.data();
  }

  std::vector<int> rank, column_start;
  BlockPattern view;
};

TEST(PairLoops, BlocksHaveTheSameBitsAndTheDefinition) {
  for (const int d : {2, 3}) {
    for (const int n : {3, 61}) {
      SCOPED_TRACE(testing::Message() << d << "D, " << n << " grains");
      const Packing packing = RandomPacking(d, n, n == 3 ? 3.9 : 0.95, 5);
      const std::vector<double> w(d * n, 0.0);
      Pairs pairs;
      MakePairs(packing, 0.6, /*stiff=*/true, &pairs);
      const Pattern pattern(pairs, d, n);
      EXPECT_EQ(pattern.view.has_shared_blocks, n == 3);
      const std::size_t m = pairs.view.num_pairs;
      std::vector<double> first(m), second(m);
      for (std::size_t p = 0; p < m; ++p) {
        first[p] = 1.0 + std::sin(3.0 * p);
        second[p] = std::cos(5.0 * p);
      }
      constexpr double kTheta = 0.7;
      std::vector<double> of_first_set;
      for (const NamedLoops& set : Runnable(d, 2.0)) {
        SCOPED_TRACE(set.name);
        std::vector<std::vector<double>> arrays(
            4 + d, std::vector<double>(m + kPairPadding));
        PairStates states;
        states.delta = arrays[0].data();
        states.distance = arrays[1].data();
        states.force = arrays[2].data();
        states.stiffness = arrays[3].data();
        for (int c = 0; c < d; ++c) states.normal[c] = arrays[4 + c].data();
        set.loops.states(pairs.view, 2.0, w.data(), states);
        // Centres that coincide: no block.
        states.distance[1] = 0.0;
        for (int c = 0; c < d; ++c) states.normal[c][1] = 0.0;
        std::vector<double> values(pattern.column_start.back(), std::nan(""));
        set.loops.blocks(pairs.view,
                         states,
                         first.data(),
                         second.data(),
                         kTheta,
                         pattern.view,
                         values.data());
        if (of_first_set.empty()) of_first_set = values;
        EXPECT_EQ(values, of_first_set);
        std::vector<long double> exact(values.size(), 0.0L);
        for (std::size_t p = 0; p < m; ++p) {
          if (pattern.rank[p] < 0 || p == 1) continue;
          const long double t = kTheta * second[p] / states.distance[p];
          for (int c = 0; c < d; ++c) {
            for (int r = 0; r < d; ++r) {
              const long double k =
                  (first[p] + t) * states.normal[r][p] * states.normal[c][p] -
                  (r == c ? t : 0.0L);
              const int column = pattern.column_start[d * pairs.i[p] + c];
              exact[column + (d - c) + d * pattern.rank[p] + r] -= k;
              if (r < c) continue;
              exact[column + r - c] += k;
              exact[pattern.column_start[d * pairs.j[p] + c] + r - c] += k;
            }
          }
        }
        for (std::size_t v = 0; v < values.size(); ++v) {
          EXPECT_NEAR(values[v], static_cast<double>(exact[v]), 1e-13);
        }
      }
    }
  }
}

TEST(PairLoops, DisplacementsAreDifferencesAndTheirLargest) {
  for (const NamedLoops& set : Runnable(2, 2.0)) {
    SCOPED_TRACE(set.name);
    for (const int n : {1, 2, 7, 8, 9, 64, 1001}) {
      std::vector<double> u(n), reference(n), list(n), w(n);
      for (int v = 0; v < n; ++v) {
        u[v] = std::sin(3.0 * v);
        reference[v] = std::cos(5.0 * v);
        list[v] = 0.5 * std::cos(2.0 * v);
      }
      const auto displace = [&]() {
        return set.loops.displace(
            n, u.data(), reference.data(), list.data(), w.data());
      };
      // Each entry in turn is the one that has moved most.
      for (int v = 0; v < n; v += 1 + n / 16) {
        const double before = u[v];
        u[v] = v % 2 == 0 ? -11.0 : 11.0;
        const Displacement most = displace();
        EXPECT_TRUE(most.is_finite);
        EXPECT_EQ(most.from_reference, std::abs(u[v] - reference[v]));
        EXPECT_EQ(most.from_list, std::abs(u[v] - list[v]));
        for (int k = 0; k < n; ++k) EXPECT_EQ(w[k], u[k] - reference[k]);
        for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
          u[v] = bad;
          EXPECT_FALSE(displace().is_finite) << "entry " << v << " = " << bad;
        }
        u[v] = before;
      }
    }
  }
}

TEST(PairLoops, LawsAndDimensionsThatDoNotExistHaveNone) {
  for (const double alpha : {1.9, std::nan("")}) {
    for (const NamedLoops& set : Runnable(2, alpha)) {
      EXPECT_EQ(set.loops.sweep, nullptr) << set.name;
    }
  }
  for (const int dimension : {1, 4}) {
    for (const NamedLoops& set : Runnable(dimension, 2.0)) {
      EXPECT_EQ(set.loops.sweep, nullptr) << set.name;
    }
  }
}

}  // namespace
}  // namespace granopt
