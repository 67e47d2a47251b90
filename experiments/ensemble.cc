#include "experiments/ensemble.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "experiments/children.h"
#include "experiments/distributions.h"
#include "experiments/scene.h"
#include "experiments/statistics.h"
#include "experiments/tabular.h"
#include "granular/packing_io.h"

DEFINE_string(seeds,
              "",
              "many packings: a run for each of these seeds, as in 1-20 or "
              "1,4,7 (instead of --seed)");
DEFINE_string(
    sizes,
    "",
    "with --seeds: numbers of grains, as in 64,256,1024x5 (instead of "
    "--particles); x5: with the first five seeds only");
DEFINE_int32(jobs, 1, "with --seeds: runs at a time");

namespace granopt {
namespace {

constexpr int kMaxJobs = 1024;
constexpr int kMaxSize = 10000000;

// Flags that each child gets from its parent, or must not get.
const std::vector<std::string> kOwnFlags = {
    "seeds", "sizes", "jobs", "seed", "particles", "out", "pictures", "resume"};

std::string NameOf(const Member& member) {
  return Format("n%d_seed%llu",
                member.particles,
                static_cast<unsigned long long>(member.seed));
}

void ReadMember(const Json& json, Member* member) {
  try {
    if (!json.at("found").get<bool>()) {
      member->failure = json.at("error").get<std::string>();
      return;
    }
    member->converged = json.at("converged").get<bool>();
    member->phi_j = json.at("phi_j").get<double>();
    member->error = json.at("phi_j_error").get<double>();
    member->asked_error = json.at("error_bar").get<double>();
    const Json& state = json.at("state");
    member->rigid_grains = state.at("rigid_grains").get<int>();
    member->excess_contacts = state.at("rigid_contacts").get<int>() -
                              state.at("isostatic_contacts").get<int>();
    member->rattlers = state.at("rattlers").get<int>();
    if (json.contains("certificate")) {
      member->certificate =
          json.at("certificate").at("verdict").get<std::string>();
    }
    member->cycles = json.at("cycles").get<int>();
    member->relaxations = json.at("relaxations").get<int>();
    member->evaluations = json.at("evaluations").get<std::int64_t>();
    member->seconds = json.at("seconds").get<double>();
    member->complete = true;
  } catch (const Json::exception& exception) {
    member->failure = std::string("summary.json: ") + exception.what();
  }
}

// What the packing of `member` has to say about forces and gaps.
bool ReadSamples(const std::string& folder,
                 const ContactEnergyOptions& options,
                 Member* member,
                 PackingSamples* samples) {
  Packing packing;
  std::string error;
  if (!ReadPacking(folder + "/packing.xyz", &packing, &error)) {
    member->failure = error;
    return false;
  }
  const auto energy = ContactEnergy::Create(packing, options, &error);
  if (energy == nullptr) {
    member->failure = error;
    return false;
  }
  const std::vector<double> zero(energy->NumParameters(), 0.0);
  samples->particles = member->particles;
  samples->seed = member->seed;
  if (!CollectSamples(packing,
                      energy->Contacts(zero.data()),
                      kMaxGap,
                      &samples->samples,
                      &error)) {
    member->failure = error;
    return false;
  }
  return true;
}

Json SizeJson(const SizeStatistics& s) {
  Json json;
  json["particles"] = s.particles;
  json["asked"] = s.asked;
  json["complete"] = s.complete;
  json["converged"] = s.converged;
  json["isostatic"] = s.isostatic;
  json["certified"] = s.certified;
  if (s.complete > 0) {
    json["phi_j"] = s.mean;
    json["standard_deviation"] = s.deviation;
    json["standard_error"] = s.standard_error;
    json["least"] = s.least;
    json["most"] = s.most;
    json["largest_error_bar"] = s.largest_error;
    json["rattlers"] = s.rattlers;
    json["median_seconds"] = s.median_seconds;
  }
  return json;
}

std::string SizesCsv(const std::vector<SizeStatistics>& sizes) {
  std::string csv =
      "particles,asked,complete,converged,isostatic,certified,phi_j,"
      "standard_deviation,standard_error,least,most,largest_error_bar,"
      "rattlers\n";
  for (const SizeStatistics& s : sizes) {
    if (s.complete == 0) continue;
    csv +=
        Format("%d,%d,%d,%d,%d,%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n",
               s.particles,
               s.asked,
               s.complete,
               s.converged,
               s.isostatic,
               s.certified,
               s.mean,
               s.deviation,
               s.standard_error,
               s.least,
               s.most,
               s.largest_error,
               s.rattlers);
  }
  return csv;
}

void PrintMembers(const std::vector<Member>& members) {
  std::vector<std::vector<std::string>> rows = {{"grains",
                                                 "seed",
                                                 "phi_J",
                                                 "error bar",
                                                 "excess",
                                                 "rattlers",
                                                 "cycles",
                                                 "relaxations",
                                                 "evaluations",
                                                 "s",
                                                 "certificate"}};
  bool all_converged = true;
  for (const Member& m : members) {
    rows.push_back({Format("%d", m.particles),
                    Format("%llu", static_cast<unsigned long long>(m.seed))});
    if (!m.complete) {
      rows.back().resize(rows[0].size(), "-");
      rows.back().back() = m.failure;
      continue;
    }
    all_converged = all_converged && m.converged;
    rows.back().insert(rows.back().end(),
                       {Format("%.12f", m.phi_j),
                        Format("%.1e%s", m.error, m.converged ? "" : "!"),
                        Format("%d", m.excess_contacts),
                        Format("%d", m.rattlers),
                        Format("%d", m.cycles),
                        Format("%d", m.relaxations),
                        Format("%lld", static_cast<long long>(m.evaluations)),
                        Format("%.3g", m.seconds),
                        m.certificate.empty() ? "none" : m.certificate});
  }
  std::printf("\n%s", Grid(rows, 1, false).c_str());
  if (!all_converged) std::printf("    ! error bar above what was asked\n");
}

void PrintSizes(const std::vector<SizeStatistics>& sizes) {
  std::vector<std::vector<std::string>> rows = {{"grains",
                                                 "packings",
                                                 "mean phi_J",
                                                 "deviation",
                                                 "s. e.",
                                                 "least",
                                                 "most",
                                                 "largest error bar",
                                                 "isostatic",
                                                 "certified"}};
  bool isostatic = true;
  for (const SizeStatistics& s : sizes) {
    rows.push_back({Format("%d", s.particles), Format("%d", s.complete)});
    if (s.complete == 0) {
      rows.back().resize(rows[0].size(), "-");
      continue;
    }
    rows.back().insert(rows.back().end(),
                       {Format("%.6f", s.mean),
                        Format("%.6f", s.deviation),
                        Format("%.6f", s.standard_error),
                        Format("%.6f", s.least),
                        Format("%.6f", s.most),
                        Format("%.1e", s.largest_error),
                        Format("%d of %d", s.isostatic, s.complete),
                        Format("%d of %d", s.certified, s.complete)});
    isostatic = isostatic && s.isostatic == s.complete;
  }
  std::printf("\n%s", Grid(rows, 0, false).c_str());
  if (!isostatic) {
    std::printf(
        "  not all are isostatic: loops of equal grains may close by "
        "themselves; with radii that all\n  differ (--polydispersity=1e-3) "
        "none was seen to in some hundred packings\n");
  }
}

using SizeFits = std::vector<std::pair<int, DistributionFits>>;

Json LineJson(const LineFit& line, double exponent) {
  return {{"phi_infinity", line.a},
          {"phi_infinity_error", line.a_error},
          {"c", -line.b},
          {"c_error", line.b_error},
          {"exponent", exponent},
          {"chi2", line.chi2},
          {"degrees_of_freedom", line.n - 2}};
}

void Plot(
    const LineFit& line, double exponent, int d, bool several, Output* output) {
  output->Plot({"ensemble",
                output->Path("ensemble.csv"),
                output->Path("ensemble"),
                Format("--dimension=%d", d)},
               {"ensemble.svg", "ensemble.png"});
  std::vector<std::string> arguments = {"finite_size",
                                        output->Path("sizes.csv"),
                                        output->Path("finite_size"),
                                        Format("--dimension=%d", d)};
  if (line.n > 0) {
    arguments.push_back(Format("--fit=%.17g,%.17g,%.17g,%.17g,%.17g",
                               line.a,
                               line.a_error,
                               -line.b,
                               line.b_error,
                               exponent));
  }
  if (several) {
    output->Plot(arguments, {"finite_size.svg", "finite_size.png"});
  }
}

void PrintFits(const LineFit& line,
               double exponent,
               int d,
               const SizeFits& fits) {
  if (line.n > 0) {
    std::printf(
        "\n  N -> infinity %.6f +- %.6f, phi_J(N) = that - (%.4f +- %.4f) "
        "N^-%.3f%s\n",
        line.a,
        line.a_error,
        -line.b,
        line.b_error,
        exponent,
        line.n > 2
            ? Format(", chi^2 = %.1f of %d", line.chi2, line.n - 2).c_str()
            : "");
    if (d == 2) {
      std::printf("  literature    0.8418 for a rapid quench\n");
    }
  }
  std::printf("\n  weak forces P(f) ~ f^theta, small gaps P(h) ~ h^-gamma\n");
  for (const auto& [size, fit] : fits) {
    std::printf("    %6d  %s\n", size, FitsLine(fit).c_str());
  }
  std::printf("    theory  theta_l = %.3f, theta_e = %.3f, gamma = %.3f\n",
              kThetaLocalized,
              kThetaExtended,
              kGamma);
}

}  // namespace

Ensemble ReadEnsembleFlags(const std::vector<std::string>& own) {
  Ensemble ensemble;
  ensemble.asked = IsGiven("seeds");
  if (!ensemble.asked) {
    for (const char* flag : {"sizes", "jobs"}) {
      if (IsGiven(flag)) BadInput(std::string("--") + flag + " needs --seeds");
    }
    return ensemble;
  }
  std::string error;
  if (!ParseSeeds(FLAGS_seeds, &ensemble.seeds, &error)) {
    BadInput("--seeds: " + error);
  }
  if (IsGiven("seed")) BadInput("--seed and --seeds exclude each other");
  if (IsGiven("input")) {
    BadInput("--seeds describes random starts and cannot go with --input");
  }
  if (IsGiven("sizes")) {
    if (IsGiven("particles")) {
      BadInput("--particles and --sizes exclude each other");
    }
    // "64,4096x3": what follows an x is taken out first.
    std::string numbers;
    for (const std::string& part : Split(FLAGS_sizes, ',')) {
      const std::size_t x = part.find('x');
      std::size_t most = ensemble.seeds.size();
      if (x != std::string::npos) {
        std::int64_t count = 0;
        if (!ParseInteger(part.substr(x + 1), &count) || count < 1 ||
            count > static_cast<std::int64_t>(most)) {
          BadInput("--sizes: " + part +
                   ": after the x belongs how many of the " +
                   Format("%zu seeds", most));
        }
        most = static_cast<std::size_t>(count);
      }
      ensemble.seeds_of_size.push_back(most);
      numbers += (numbers.empty() ? "" : ",") + part.substr(0, x);
    }
    std::vector<double> sizes;
    if (!ParsePositives(numbers, &sizes, &error)) {
      BadInput("--sizes: " + error);
    }
    for (const double size : sizes) {
      if (size != std::floor(size) || !(size >= 1 && size <= kMaxSize)) {
        BadInput(Format(
            "--sizes: %g is no number of grains in [1, %d]", size, kMaxSize));
      }
      ensemble.sizes.push_back(static_cast<int>(size));
    }
  }
  CheckRange("jobs", FLAGS_jobs, 1, kMaxJobs);
  ensemble.jobs = FLAGS_jobs;
  gflags::CommandLineFlagInfo info;
  ensemble.resume = gflags::GetCommandLineFlagInfo("resume", &info) &&
                    info.current_value == "true";
  std::vector<std::string> not_passed = kOwnFlags;
  not_passed.insert(not_passed.end(), own.begin(), own.end());
  ensemble.passed = PassedFlags(not_passed);
  return ensemble;
}

std::vector<int> Ensemble::Sizes() const {
  return sizes.empty() ? std::vector<int>{FLAGS_particles} : sizes;
}

std::vector<Ensemble::Run> Ensemble::Runs() const {
  std::vector<Run> runs;
  const std::vector<int> all = Sizes();
  for (std::size_t k = 0; k < all.size(); ++k) {
    const std::size_t most = sizes.empty() ? seeds.size() : seeds_of_size[k];
    for (std::size_t n = 0; n < most; ++n) {
      Run run;
      run.particles = all[k];
      run.seed = seeds[n];
      run.arguments = passed;
      run.arguments.push_back(
          Format("--seed=%llu", static_cast<unsigned long long>(run.seed)));
      run.arguments.push_back(Format("--particles=%d", run.particles));
      run.weight = std::pow(run.particles, 1.5);
      runs.push_back(run);
    }
  }
  return runs;
}

SizeStatistics Summarize(const std::vector<Member>& members, int particles) {
  SizeStatistics s;
  s.particles = particles;
  s.least = std::numeric_limits<double>::infinity();
  s.most = -s.least;
  std::vector<double> seconds, phi_j;
  double rattlers = 0.0;
  for (const Member& m : members) {
    if (m.particles != particles) continue;
    ++s.asked;
    if (!m.complete) continue;
    ++s.complete;
    s.converged += m.converged ? 1 : 0;
    s.isostatic += m.excess_contacts == 0 ? 1 : 0;
    s.certified += m.certificate == "strict minimum" ? 1 : 0;
    rattlers += static_cast<double>(m.rattlers) / m.particles;
    s.least = std::min(s.least, m.phi_j);
    s.most = std::max(s.most, m.phi_j);
    s.largest_error = std::max(s.largest_error, m.error);
    phi_j.push_back(m.phi_j);
    seconds.push_back(m.seconds);
  }
  if (s.complete == 0) {
    s.least = s.most = 0.0;
    return s;
  }
  const MeanDeviation all = MeanAndDeviation(phi_j);
  s.mean = all.mean;
  s.deviation = all.deviation;
  s.standard_error = all.standard_error;
  s.rattlers = rattlers / s.complete;
  s.median_seconds = MedianOf(seconds);
  return s;
}

double FiniteSizeExponent(int dimension) { return 1.41 / dimension; }

LineFit FitFiniteSize(const std::vector<SizeStatistics>& sizes,
                      double exponent) {
  std::vector<double> x, y, error;
  for (const SizeStatistics& s : sizes) {
    if (s.complete < 2 || !(s.standard_error > 0.0)) continue;
    x.push_back(std::pow(s.particles, -exponent));
    y.push_back(s.mean);
    error.push_back(s.standard_error);
  }
  return FitLine(x, y, error);
}

std::string EnsembleCsv(const std::vector<Member>& members) {
  std::string csv =
      "particles,seed,phi_j,error,converged,rigid_grains,excess_contacts,"
      "rattlers,certificate,cycles,relaxations,evaluations,seconds\n";
  for (const Member& m : members) {
    if (!m.complete) continue;
    // Verdicts have commas in them.
    csv += Format("%d,%llu,%.17g,%.17g,%d,%d,%d,%d,\"%s\",%d,%d,%lld,%.6g\n",
                  m.particles,
                  static_cast<unsigned long long>(m.seed),
                  m.phi_j,
                  m.error,
                  m.converged ? 1 : 0,
                  m.rigid_grains,
                  m.excess_contacts,
                  m.rattlers,
                  m.certificate.c_str(),
                  m.cycles,
                  m.relaxations,
                  static_cast<long long>(m.evaluations),
                  m.seconds);
  }
  return csv;
}

int RunEnsemble(const Ensemble& ensemble, const ContactEnergyOptions& energy) {
  const std::vector<int> sizes = ensemble.Sizes();
  Output output;
  output.Create(FLAGS_out,
                WithDistributionFiles({"summary.json",
                                       "ensemble.csv",
                                       "sizes.csv",
                                       "ensemble.svg",
                                       "ensemble.png",
                                       "finite_size.svg",
                                       "finite_size.png"}));
  std::vector<Member> members;
  std::vector<Child> children;
  for (const Ensemble::Run& run : ensemble.Runs()) {
    Member member;
    member.particles = run.particles;
    member.seed = run.seed;
    children.push_back({NameOf(member), run.arguments, run.weight});
    members.push_back(member);
  }
  const int d = FLAGS_dimension;
  std::printf("jamming   %zu packings, alpha = %g: seeds %s, grains",
              members.size(),
              energy.alpha,
              FLAGS_seeds.c_str());
  for (const int size : sizes) std::printf(" %d", size);
  std::printf("; %d at a time\n", ensemble.jobs);

  bool interrupted = false;
  const std::vector<ChildResult> results = RunChildren("jamming",
                                                       children,
                                                       ensemble.jobs,
                                                       ensemble.resume,
                                                       /*children_resume=*/true,
                                                       output,
                                                       &interrupted);
  std::vector<PackingSamples> samples;
  for (std::size_t k = 0; k < members.size(); ++k) {
    Member& member = members[k];
    member.failure = results[k].failure;
    if (!member.failure.empty()) continue;
    ReadMember(results[k].summary, &member);
    PackingSamples s;
    if (member.complete &&
        ReadSamples(output.Path(NameOf(member)), energy, &member, &s)) {
      samples.push_back(std::move(s));
    }
  }

  std::vector<SizeStatistics> statistics;
  std::string rows;
  Json json;
  json["packings"] = members.size();
  json["interrupted"] = interrupted;
  json["dimension"] = d;
  json["alpha"] = energy.alpha;
  json["failures"] = Json::array();
  bool all = true;
  int complete = 0;
  for (const Member& m : members) {
    all = all && m.complete && m.converged;
    complete += m.complete ? 1 : 0;
    if (m.failure.empty()) continue;
    json["failures"].push_back({{"run", NameOf(m)}, {"line", m.failure}});
  }
  json["sizes"] = Json::array();
  SizeFits fits;
  for (const int size : sizes) {
    statistics.push_back(Summarize(members, size));
    json["sizes"].push_back(SizeJson(statistics.back()));
    std::vector<PackingSamples> of_size;
    for (const PackingSamples& s : samples) {
      if (s.particles == size) of_size.push_back(s);
    }
    fits.push_back({size, FitDistributions(of_size)});
    json["sizes"].back()["distributions"] = FitsJson(fits.back().second);
    rows += FitsCsvRows(size, fits.back().second);
  }
  const double exponent = FiniteSizeExponent(d);
  const LineFit line = FitFiniteSize(statistics, exponent);
  if (line.n > 0) json["finite_size"] = LineJson(line, exponent);
  json["schema"] = "granopt/jamming_ensemble/1";
  json["provenance"] = Provenance();

  output.Write("ensemble.csv", EnsembleCsv(members));
  output.Write("sizes.csv", SizesCsv(statistics));
  WriteDistributions(samples, rows, &output);
  output.WriteJson("summary.json", json);
  if (complete > 0) Plot(line, exponent, d, sizes.size() > 1, &output);
  PrintMembers(members);
  PrintSizes(statistics);
  PrintFits(line, exponent, d, fits);
  if (interrupted) {
    std::printf("\ninterrupted: %d of %zu packings have a result\n",
                complete,
                members.size());
  }
  output.PrintFiles();
  return all ? kConverged : kNotConverged;
}

}  // namespace granopt
