#include "experiments/run.h"

#include <dirent.h>
#include <dlfcn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <new>
#include <set>
#include <thread>

#include "Eigen/Core"
#include "ceres/version.h"
#include "experiments/build_info.h"
#include "experiments/help.h"
#include "generated/git_revision.h"
#include "glog/logging.h"
#include "granular/atomic_file.h"
#include "granular/packing_io.h"
#include "solvers/sparse_cholesky.h"
#include "solvers/threads.h"

DEFINE_string(out, "", "folder for the results; default out/<binary>");
DEFINE_uint64(seed, 1, "seed of every random number");
DEFINE_bool(smoke, false, "a run of seconds, to see that everything works");
DEFINE_bool(pictures, true, "draw figures (needs python3 with matplotlib)");

namespace google {
// gflags calls this on every parse error; its headers do not declare it.
extern void (*gflags_exitfunc)(int);
}  // namespace google

namespace granopt {
namespace {

std::string* BinaryName() {
  static std::string name = "granopt";
  return &name;
}

std::vector<std::string>* CommandLine() {
  static std::vector<std::string> words;
  return &words;
}

// What follows the colon there; "unknown" without such a line.
std::string FirstLineWith(const char* path, const char* prefix) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    if (line.rfind(prefix, 0) == 0) {
      const std::size_t colon = line.find(':');
      if (colon == std::string::npos) return line;
      const std::size_t start = line.find_first_not_of(" \t", colon + 1);
      return start == std::string::npos ? "" : line.substr(start);
    }
  }
  return "unknown";
}

// Libraries of linear algebra that this process has mapped.
std::vector<std::string> LoadedBlas() {
  std::set<std::string> found;
  std::ifstream maps("/proc/self/maps");
  for (std::string line; std::getline(maps, line);) {
    const std::size_t slash = line.find('/');
    if (slash == std::string::npos) continue;
    const std::string path = line.substr(slash);
    const std::string file = path.substr(path.rfind('/') + 1);
    for (const char* name : {"libblas",
                             "libopenblas",
                             "libatlas",
                             "libcblas",
                             "libf77blas",
                             "libblis",
                             "libmkl"}) {
      if (file.rfind(name, 0) == 0) found.insert(path);
    }
  }
  return {found.begin(), found.end()};
}

// The library whose dgemm a call from this binary reaches.
std::string DgemmLibrary() {
  void* const dgemm = dlsym(RTLD_DEFAULT, "dgemm_");
  Dl_info info;
  if (dgemm == nullptr || dladdr(dgemm, &info) == 0) return "none";
  return info.dli_fname;
}

}  // namespace

void BadInput(const std::string& line) {
  // One line, whatever a file or flag put into it.
  std::string printable = line;
  for (char& c : printable) {
    if (static_cast<unsigned char>(c) < 32) c = '?';
  }
  std::fprintf(stderr, "%s: %s\n", BinaryName()->c_str(), printable.c_str());
  std::exit(kBadInput);
}

void ParseFlags(int* argc, char*** argv, const char* purpose) {
  google::InitGoogleLogging((*argv)[0]);
  FLAGS_logtostderr = true;
  const std::string path = (*argv)[0];
  *BinaryName() = path.substr(path.rfind('/') + 1);
  CommandLine()->assign(*argv, *argv + *argc);
  std::set_new_handler([] {
    std::fprintf(stderr, "%s: out of memory\n", BinaryName()->c_str());
    std::_Exit(kBadInput);
  });
  // A limit on file sizes is an error of write(), not the end of the process.
  std::signal(SIGXFSZ, SIG_IGN);
  google::gflags_exitfunc = [](int) { std::exit(kBadInput); };
  gflags::SetVersionString(GRANOPT_GIT_REVISION);
  for (int a = 1; a < *argc; ++a) {
    const std::string word = (*argv)[a];
    if (word.rfind("--help", 0) == 0 || word == "-help" || word == "-h") {
      std::printf("%s", HelpText(*BinaryName(), purpose).c_str());
      std::exit(kConverged);
    }
    if (word == "--version") {
      std::printf("%s %s\n", BinaryName()->c_str(), GRANOPT_GIT_REVISION);
      std::exit(kConverged);
    }
  }
  gflags::ParseCommandLineNonHelpFlags(argc, argv, /*remove_flags=*/true);
  if (*argc > 1) {
    BadInput(std::string("'") + (*argv)[1] +
             "' is not a flag (see --help); values are given as --flag=value");
  }
  if (FLAGS_out.empty()) {
    if (IsGiven("out")) BadInput("--out= is empty");
    // As its default, so that IsGiven() stays false.
    gflags::SetCommandLineOptionWithMode(
        "out", ("out/" + *BinaryName()).c_str(), gflags::SET_FLAGS_DEFAULT);
  }
}

bool IsGiven(const char* flag) {
  return !gflags::GetCommandLineFlagInfoOrDie(flag).is_default;
}

void Require(bool good, const char* flag, const std::string& error) {
  if (!good) BadInput(std::string("--") + flag + ": " + error);
}

void CheckRange(const char* flag, double value, double low, double high) {
  if (value >= low && value <= high) return;
  BadInput(Format("--%s=%g must be in [%g, %g]", flag, value, low, high));
}

void CheckPositive(const char* flag, double value) {
  if (value > 0.0 && std::isfinite(value)) return;
  BadInput(Format("--%s=%g must be positive", flag, value));
}

namespace {

// What a run that was killed left of the files that it was writing:
// "<name>.<process>.tmp".
void RemoveTemporaries(const std::string& folder,
                       const std::vector<std::string>& names) {
  DIR* directory = opendir(folder.c_str());
  if (directory == nullptr) return;
  while (const dirent* entry = readdir(directory)) {
    const std::string file = entry->d_name;
    if (file.size() < 4 || file.substr(file.size() - 4) != ".tmp") continue;
    for (const std::string& name : names) {
      if (file.rfind(name + ".", 0) == 0) {
        unlink((folder + "/" + file).c_str());
        break;
      }
    }
  }
  closedir(directory);
}

}  // namespace

void Output::Create(const std::string& folder,
                    const std::vector<std::string>& names,
                    const std::vector<std::string>& kept) {
  folder_ = folder;
  while (folder_.size() > 1 && folder_.back() == '/') folder_.pop_back();
  for (std::size_t at = 1; at <= folder_.size(); ++at) {
    if (at < folder_.size() && folder_[at] != '/') continue;
    const std::string part = folder_.substr(0, at);
    if (mkdir(part.c_str(), 0755) != 0 && errno != EEXIST) {
      BadInput("--out: cannot create folder '" + part +
               "': " + std::strerror(errno));
    }
  }
  struct stat status;
  if (stat(folder_.c_str(), &status) != 0 || !S_ISDIR(status.st_mode)) {
    BadInput("--out: '" + folder_ + "' is not a folder");
  }
  if (access(folder_.c_str(), W_OK | X_OK) != 0) {
    BadInput("--out: cannot write in '" + folder_ +
             "': " + std::strerror(errno));
  }
  for (const std::string& name : names) {
    if (lstat(Path(name).c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
      BadInput("--out: '" + Path(name) + "' is in the way (not a file)");
    }
  }
  for (const std::string& name : names) unlink(Path(name).c_str());
  RemoveTemporaries(folder_, names);
  RemoveTemporaries(folder_, kept);
}

void Output::Write(const std::string& name, const std::string& content) {
  std::string error;
  if (!WriteFileAtomically(Path(name), content, &error)) BadInput(error);
  if (std::find(files_.begin(), files_.end(), name) == files_.end()) {
    files_.push_back(name);
  }
}

void Output::WritePacking(const std::string& name, const Packing& packing) {
  Write(name, FormatPacking(packing));
}

void Output::WriteJson(const std::string& name, const Json& json) {
  Write(name, json.dump(2) + "\n");
}

void Output::WriteRelaxation(const Relaxation& relaxation,
                             const ContactEnergyOptions& law) {
  WritePacking("packing.xyz", Annotated(relaxation, law));
  Write("contacts.csv", ContactsCsv(relaxation));
}

bool Output::PlotPacking() {
  return Plot(
      {"packing", Path("packing.xyz"), Path("contacts.csv"), Path("packing")},
      {"packing.svg", "packing.png"});
}

bool Output::Plot(const std::vector<std::string>& arguments,
                  const std::vector<std::string>& made) {
  if (!FLAGS_pictures) return false;
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0) {
    std::vector<std::string> words = {"python3", GRANOPT_PLOT_SCRIPT};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    // Debian's own interpreter is the one that has Debian's matplotlib. It
    // finds its library by its name, which must not be found in PATH as
    // another.
    char debian[] = "/usr/bin/python3";
    argv[0] = debian;
    execv(debian, argv.data());
    argv[0] = words[0].data();
    execvp("python3", argv.data());
    _exit(127);
  }
  int status = 0;
  const bool succeeded = child > 0 && waitpid(child, &status, 0) == child &&
                         WIFEXITED(status) && WEXITSTATUS(status) == 0;
  if (succeeded) {
    files_.insert(files_.end(), made.begin(), made.end());
  } else {
    std::fprintf(stderr,
                 "%s: no picture '%s': python3 %s failed\n",
                 BinaryName()->c_str(),
                 arguments.empty() ? "" : arguments[0].c_str(),
                 GRANOPT_PLOT_SCRIPT);
  }
  return succeeded;
}

void Output::PrintFiles() const {
  std::printf("\nfiles in %s\n ", folder_.c_str());
  for (const std::string& name : files_) std::printf(" %s", name.c_str());
  std::printf("\n");
}

Json Provenance() {
  Json json;
  json["granopt"] = GRANOPT_GIT_REVISION;
  json["command"] = *CommandLine();
  json["seed"] = FLAGS_seed;
  json["compiler"] = GRANOPT_COMPILER;
  json["flags"] = GRANOPT_FLAGS;
  json["cpu"] = FirstLineWith("/proc/cpuinfo", "model name");
  json["hardware_threads"] = std::thread::hardware_concurrency();
  json["threads"] = NumThreads();
  json["libraries"] = {{"ceres", CERES_VERSION_STRING},
                       {"eigen",
                        Format("%d.%d.%d",
                               EIGEN_WORLD_VERSION,
                               EIGEN_MAJOR_VERSION,
                               EIGEN_MINOR_VERSION)},
                       {"sparse_cholesky", SparseCholesky::Library()},
                       {"glog", GRANOPT_GLOG_VERSION},
                       {"gflags", GRANOPT_GFLAGS_VERSION}};
  json["blas"] = {{"dgemm", DgemmLibrary()}, {"loaded", LoadedBlas()}};
  char when[32];
  const std::time_t now = std::time(nullptr);
  std::strftime(when, sizeof(when), "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  json["time"] = when;
  return json;
}

Json RelaxationJson(const Relaxation& relaxation) {
  const Summary& s = relaxation.summary;
  const Observables& o = relaxation.observables;
  Json json;
  json["solver"] = s.solver;
  json["converged"] = s.Succeeded();
  json["stop_reason"] = StopReasonName(s.reason);
  json["message"] = s.message;
  json["iterations"] = s.counters.iterations;
  json["evaluations"] = s.counters.evaluations;
  json["hessians"] = s.counters.hessians;
  json["factorizations"] = s.counters.factorizations;
  json["solves"] = s.counters.solves;
  json["linear_iterations"] = s.counters.linear_iterations;
  json["restarts"] = s.counters.restarts;
  json["recenters"] = s.counters.recenters;
  json["rebases"] = s.counters.rebases;
  json["list_builds"] = relaxation.list_builds;
  json["seconds"] = s.seconds;
  json["function_seconds"] = s.function_seconds;
  json["energy"] = o.energy;
  json["max_gradient"] = s.max_gradient;
  json["mean_force"] = o.mean_force;
  json["mean_overlap"] = o.mean_overlap;
  json["pressure"] = o.pressure;
  json["shear_stress"] = o.shear_stress;
  json["deviatoric_stress"] = o.stress_parts.deviatoric;
  json["isotropic_fabric"] = o.fabric_parts.isotropic;
  json["deviatoric_fabric"] = o.fabric_parts.deviatoric;
  json["coordination"] = o.coordination;
  json["contacts"] = o.contacts;
  json["rigid_grains"] = o.rigid_grains;
  json["rigid_contacts"] = o.rigid_contacts;
  json["isostatic_contacts"] = o.isostatic_contacts;
  json["smallest_force"] = o.smallest_force;
  json["rattlers"] = o.rattlers;
  json["phi"] = o.packing_fraction;
  return json;
}

std::string ContactsCsv(const Relaxation& relaxation) {
  std::string csv =
      "i,j,image_x,image_y,image_z,overlap,force,distance,nx,ny,nz,rigid\n";
  const std::vector<bool>& rattler = relaxation.observables.is_rattler;
  for (const Contact& c : relaxation.contacts) {
    csv += Format("%d,%d,%d,%d,%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%d\n",
                  c.id.i,
                  c.id.j,
                  c.id.image[0],
                  c.id.image[1],
                  c.id.image[2],
                  c.overlap,
                  c.force,
                  c.distance,
                  c.normal[0],
                  c.normal[1],
                  c.normal.size() > 2 ? c.normal[2] : 0.0,
                  !rattler[c.id.i] && !rattler[c.id.j] ? 1 : 0);
  }
  return csv;
}

std::string TraceCsv(const Summary& summary) {
  std::string csv =
      "iteration,evaluations,energy,max_gradient,mean_force,vanishing,"
      "method,seconds\n";
  for (const TraceRow& row : summary.trace) {
    csv += Format("%lld,%lld,%.17g,%.17g,%.17g,%.17g,%s,%.6g\n",
                  static_cast<long long>(row.iteration),
                  static_cast<long long>(row.evaluations),
                  row.cost,
                  row.max_gradient,
                  row.gradient_scale,
                  row.vanishing,
                  row.method.data(),
                  row.seconds);
  }
  return csv;
}

Packing Annotated(const Relaxation& relaxation,
                  const ContactEnergyOptions& options) {
  Packing packing = relaxation.packing;
  const Observables& o = relaxation.observables;
  packing.attributes["alpha"] = Format("%.17g", options.alpha);
  packing.attributes["k"] = Format("%.17g", options.stiffness);
  packing.attributes["phi"] = Format("%.17g", o.packing_fraction);
  packing.attributes["energy"] = Format("%.17g", o.energy);
  packing.attributes["pressure"] = Format("%.17g", o.pressure);
  packing.attributes["coordination"] = Format("%.17g", o.coordination);
  packing.attributes["rattlers"] = Format("%d", o.rattlers);
  return packing;
}

double CpuSeconds() {
  std::timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) +
         1e-9 * static_cast<double>(now.tv_nsec);
}

double WallSeconds() {
  return std::chrono::duration<double>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::string Describe(const Packing& packing) {
  return Format("%d %s, radii %.5g to %.5g",
                packing.size(),
                packing.dimension() == 2 ? "discs" : "spheres",
                packing.radii.minCoeff(),
                packing.radii.maxCoeff());
}

std::string IterationLine(const IterationState& state) {
  return Format("iteration %lld: |g| / mean force %.1e",
                static_cast<long long>(state.counters.iterations),
                state.scales.gradient > 0
                    ? state.max_gradient / state.scales.gradient
                    : 0.0);
}

Progress::Progress()
    : terminal_(isatty(STDERR_FILENO) != 0),
      last_(std::chrono::steady_clock::now()) {}

Progress::~Progress() { Clear(); }

bool Progress::Due() {
  const auto now = std::chrono::steady_clock::now();
  const double waited = std::chrono::duration<double>(now - last_).count();
  if (waited < (terminal_ ? 0.2 : 10.0)) return false;
  last_ = now;
  return true;
}

void Progress::Show(const std::string& line) {
  if (terminal_) {
    std::fprintf(stderr, "\r\033[K%s", line.c_str());
    std::fflush(stderr);
    shown_ = true;
  } else {
    std::fprintf(stderr, "%s\n", line.c_str());
  }
}

void Progress::Clear() {
  if (!shown_) return;
  std::fprintf(stderr, "\r\033[K");
  std::fflush(stderr);
  shown_ = false;
}

}  // namespace granopt
