#include "experiments/checkpoint.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <type_traits>
#include <utility>

#include "boost/crc.hpp"
#include "granular/atomic_file.h"
#include "granular/packing_io.h"

namespace granopt {
namespace {

constexpr char kCheckpoint[] = "checkpoint.cbor";

volatile std::sig_atomic_t stop_requested = 0;

void NoteStop(int signal) {
  stop_requested = 1;
  // Whoever asks again means it.
  std::signal(signal, SIG_DFL);
}

std::string Header(const std::string& body) {
  return Format("granopt-checkpoint 1 %zu %08x\n", body.size(), Crc32(body));
}

// ---------------------------------------------------------------- archives
//
// One list of fields serves both directions: Fields(archive, object) calls
// archive("name", object.name) for each.

template <typename T>
constexpr bool kIsMatrix = std::is_base_of_v<Eigen::MatrixBase<T>, T>;

// A vector whose elements can be copied byte by byte.
template <typename T>
constexpr bool kIsPlainArray = false;
template <typename T>
constexpr bool kIsPlainArray<std::vector<T>> = std::is_trivially_copyable_v<T>;

class Writer {
 public:
  template <typename T>
  void operator()(const char* name, const T& value) {
    json_[name] = Convert(value);
  }
  Json Take() { return std::move(json_); }

 private:
  // Numbers as they lie in memory: for machines of one byte order.
  static Json Bytes(const void* data, std::size_t size) {
    const auto* first = static_cast<const std::uint8_t*>(data);
    return Json::binary(std::vector<std::uint8_t>(first, first + size));
  }
  template <typename T>
  static Json Convert(const T& value) {
    if constexpr (kIsMatrix<T>) {
      return {value.rows(),
              value.cols(),
              Bytes(value.data(), sizeof(double) * value.size())};
    } else if constexpr (kIsPlainArray<T>) {
      return Bytes(value.data(), sizeof(value[0]) * value.size());
    } else if constexpr (std::is_enum_v<T>) {
      return static_cast<int>(value);
    } else if constexpr (std::is_constructible_v<Json, T>) {
      return value;
    } else {
      Writer part;
      Fields(part, value);
      return part.Take();
    }
  }

  Json json_ = Json::object();
};

class Reader {
 public:
  explicit Reader(const Json& json) : json_(json) {}
  template <typename T>
  void operator()(const char* name, T& value) {
    Convert(json_.at(name), &value);
  }

 private:
  static void Copy(const Json& json, void* data, std::size_t size) {
    const auto& bytes = json.get_binary();
    if (bytes.size() != size) {
      throw Json::other_error::create(501, "array of another size", &json);
    }
    if (size > 0) std::memcpy(data, bytes.data(), size);
  }
  template <typename T>
  static void Convert(const Json& json, T* value) {
    if constexpr (kIsMatrix<T>) {
      value->resize(json.at(0).get<Eigen::Index>(),
                    json.at(1).get<Eigen::Index>());
      Copy(json.at(2), value->data(), sizeof(double) * value->size());
    } else if constexpr (kIsPlainArray<T>) {
      constexpr std::size_t kSize = sizeof((*value)[0]);
      value->resize(json.get_binary().size() / kSize);
      Copy(json, value->data(), kSize * value->size());
    } else if constexpr (std::is_enum_v<T>) {
      *value = static_cast<T>(json.get<int>());
    } else if constexpr (std::is_constructible_v<Json, T>) {
      json.get_to(*value);
    } else {
      Reader part(json);
      Fields(part, *value);
    }
  }

  const Json& json_;
};

// `T` is const for a Writer.
template <typename T, typename U>
using IfSame =
    std::enable_if_t<std::is_same_v<std::remove_const_t<T>, U>, bool>;

template <typename A, typename T, IfSame<T, Counters> = true>
void Fields(A& a, T& c) {
  a("iterations", c.iterations);
  a("evaluations", c.evaluations);
  a("hessians", c.hessians);
  a("factorizations", c.factorizations);
  a("solves", c.solves);
  a("linear_iterations", c.linear_iterations);
  a("restarts", c.restarts);
  a("recenters", c.recenters);
  a("rebases", c.rebases);
}

template <typename A, typename T, IfSame<T, Scales> = true>
void Fields(A& a, T& s) {
  a("gradient", s.gradient);
  a("length", s.length);
  a("vanishing", s.vanishing);
}

// But for the trace.
template <typename A, typename T, IfSame<T, Summary> = true>
void Fields(A& a, T& s) {
  a("solver", s.solver);
  a("reason", s.reason);
  a("message", s.message);
  a("initial_cost", s.initial_cost);
  a("cost", s.cost);
  a("max_gradient", s.max_gradient);
  a("tolerance", s.tolerance);
  a("scales", s.scales);
  a("counters", s.counters);
  a("seconds", s.seconds);
  a("function_seconds", s.function_seconds);
  a("linear_seconds", s.linear_seconds);
}

void Fields(Writer& a, const Box& box) { a("edges", box.edges()); }
void Fields(Reader& a, Box& box) {
  SmallMatrix edges;
  a("edges", edges);
  box = Box(edges);
}

template <typename A, typename T, IfSame<T, Packing> = true>
void Fields(A& a, T& p) {
  a("box", p.box);
  a("positions", p.positions);
  a("positions_low", p.positions_low);
  a("radii", p.radii);
  a("stiffness", p.stiffness);
  a("species", p.species);
  a("attributes", p.attributes);
}

template <typename A, typename T, IfSame<T, JammingState> = true>
void Fields(A& a, T& s) {
  a("stage", s.stage);
  a("next", s.next);
  a("phi_next", s.phi_next);
  a("attempt", s.attempt);
  a("start", s.start);
  a("reference", s.reference);
  a("unjammed", s.unjammed);
  a("jammed", s.jammed);
  a("summary", s.summary);
  a("pressure", s.pressure);
  a("affine_slope", s.affine_slope);
  a("rigid_contacts", s.rigid_contacts);
  a("excess_contacts", s.excess_contacts);
  a("phi_start", s.phi_start);
  a("growth_steps", s.growth_steps);
  a("phi_unjammed", s.phi_unjammed);
  a("phi_jammed", s.phi_jammed);
  a("distance", s.distance);
  a("secant", s.secant);
  a("fraction", s.fraction);
  a("failures", s.failures);
  a("decompressions", s.decompressions);
  a("contacts_kept", s.contacts_kept);
  a("cycles", s.cycles);
  a("relaxations", s.relaxations);
  a("counters", s.counters);
  a("seconds", s.seconds);
}

template <typename A, typename T, IfSame<T, RelaxationState> = true>
void Fields(A& a, T& s) {
  a("packing", s.packing);
  a("summary", s.summary);
  a("trace", s.summary.trace);
  a("list_builds", s.list_builds);
  a("legs", s.legs);
}

template <typename A, typename T, IfSame<T, EnergyLedger> = true>
void Fields(A& a, T& e) {
  a("near_field", e.near_field);
  a("soft_contact", e.soft_contact);
  a("impact", e.impact);
  a("friction", e.friction);
  a("external", e.external);
  a("damping", e.damping);
  a("boundary", e.boundary);
}

template <typename A, typename T, IfSame<T, MomentumLedger> = true>
void Fields(A& a, T& m) {
  a("external", m.external);
  a("damping", m.damping);
  a("fixed", m.fixed);
}

template <typename A, typename T, IfSame<T, FlowState> = true>
void Fields(A& a, T& s) {
  a("time", s.time);
  a("step", s.step);
  a("x", s.x);
  a("v", s.v);
  a("steps", s.steps);
  a("rejected", s.rejected);
  a("sweeps", s.sweeps);
  a("is_evaluated", s.is_evaluated);
  a("impulses", s.impulses);
  a("sticking", s.sticking);
  a("jumps", s.jumps);
  a("fast", s.fast);
  a("worst_balance", s.worst_balance);
  a("energy", s.energy);
  a("momentum", s.momentum);
  a("kinetic_start", s.kinetic_start);
  a("potential_start", s.potential_start);
  a("momentum_start", s.momentum_start);
}

template <typename A, typename T, IfSame<T, QuasistaticShearState> = true>
void Fields(A& a, T& s) {
  a("step", s.step);
  a("strain", s.strain);
  a("packing", s.packing);
  a("energy", s.energy);
  a("stress", s.stress);
  a("relaxations", s.relaxations);
  a("gave_up", s.gave_up);
  a("counters", s.counters);
  a("seconds", s.seconds);
}

template <typename A, typename T, IfSame<T, StressShearState> = true>
void Fields(A& a, T& s) {
  a("shear", s.shear);
  a("summary", s.summary);
  a("list_builds", s.list_builds);
  a("reached", s.reached);
  a("halvings", s.halvings);
  a("refused", s.refused);
  a("why", s.why);
}

// The object of a file, or false with what is wrong with it in `fault`.
bool ReadOne(const std::string& path, Json* content, std::string* fault) {
  std::string text;
  if (!ReadFile(path, &text, fault)) return false;
  const auto fail = [&](const std::string& what) {
    *fault = path + ": " + what;
    return false;
  };
  const std::size_t end = text.find('\n');
  std::size_t bytes = 0;
  if (end == std::string::npos ||
      std::sscanf(text.c_str(), "granopt-checkpoint 1 %zu", &bytes) != 1) {
    return fail("not a checkpoint of this version");
  }
  const std::string body = text.substr(end + 1);
  if (body.size() < bytes) {
    return fail(Format("cut short, %zu of %zu bytes", body.size(), bytes));
  }
  if (text.substr(0, end + 1) != Header(body)) {
    return fail("damaged, its checksum does not fit");
  }
  *content = Json::from_cbor(body, /*strict=*/true, /*allow_exceptions=*/false);
  if (!content->is_object() || !content->contains("setup") ||
      !content->contains("state")) {
    return fail("not a checkpoint of this version");
  }
  return true;
}

}  // namespace

std::uint32_t Crc32(const std::string& bytes) {
  boost::crc_32_type crc;
  crc.process_bytes(bytes.data(), bytes.size());
  return crc.checksum();
}

bool Checkpoint::Write(const Json& state, std::string* error) const {
  const std::vector<std::uint8_t> body =
      Json::to_cbor({{"setup", setup_}, {"state", state}});
  const std::string text(body.begin(), body.end());
  const std::string fresh = path_ + ".new.tmp";
  if (!WriteFileAtomically(fresh, Header(text) + text, error)) return false;
  // The new one is on the disk. The newest so far gets a second name before its
  // place is taken, so that there is always one under the first.
  const std::string second = previous() + ".link.tmp";
  unlink(second.c_str());
  if (link(path_.c_str(), second.c_str()) == 0) {
    std::rename(second.c_str(), previous().c_str());
    // Where both are names of one file already, of a run killed before its last
    // rename below, a rename does nothing.
    unlink(second.c_str());
  } else if (errno != ENOENT) {
    // A file system without links: for a moment only the older one is there.
    std::rename(path_.c_str(), previous().c_str());
  }
  if (std::rename(fresh.c_str(), path_.c_str()) != 0) {
    *error = path_ + ": cannot rename: " + std::strerror(errno);
    return false;
  }
  return true;
}

Checkpoint::Found Checkpoint::Read(Json* state,
                                   std::vector<std::string>* faults,
                                   std::string* error) const {
  for (const std::string& path : {path_, previous()}) {
    struct stat status;
    if (stat(path.c_str(), &status) != 0 && errno == ENOENT) continue;
    Json content;
    std::string fault;
    if (!ReadOne(path, &content, &fault)) {
      faults->push_back(fault);
      continue;
    }
    const Json& then = content["setup"];
    for (const auto& [key, value] : setup_.items()) {
      const Json before = then.contains(key) ? then[key] : Json();
      if (before != value) {
        *error = path + ": begun with " + key + " = " + before.dump() +
                 ", now " + value.dump();
        return Found::OTHER_SETUP;
      }
    }
    *state = std::move(content["state"]);
    return Found::OK;
  }
  return Found::NONE;
}

std::string CheckpointPath() {
  std::string folder = FLAGS_out;
  while (folder.size() > 1 && folder.back() == '/') folder.pop_back();
  return folder + "/" + kCheckpoint;
}

std::vector<std::string> CheckpointFiles() {
  return {kCheckpoint, std::string(kCheckpoint) + ".previous"};
}

Json SceneSetup(const Scene& scene, const SolveOptions& solve) {
  return {{"packing", Crc32(FormatPacking(scene.packing))},
          {"alpha", scene.energy.alpha},
          {"precision", PrecisionName(scene.energy.precision)},
          {"solver", scene.solver->name()},
          {"tolerance", solve.relative_tolerance},
          {"zero_pressure", solve.vanishing_tolerance}};
}

void CreateOutput(std::vector<std::string> names, bool resume, Output* output) {
  const std::vector<std::string> kept = CheckpointFiles();
  if (!resume) names.insert(names.end(), kept.begin(), kept.end());
  output->Create(FLAGS_out, names, kept);
  CatchStopSignals();
}

bool IsCheckpointStep(std::size_t step) {
  std::size_t every = 1;
  while (step >= 512 * every) every *= 2;
  return step % every == 0;
}

void Save(const Checkpoint& checkpoint, const Json& state) {
  std::string error;
  if (!checkpoint.Write(state, &error)) BadInput(error);
}

int StoppedAsAsked(const std::string& where) {
  std::printf(
      "\nstopped as asked, %s: the same command with --resume goes on\n",
      where.c_str());
  return kNotConverged;
}

bool Resume(const Checkpoint& checkpoint, Json* state) {
  std::vector<std::string> faults;
  std::string error;
  const Checkpoint::Found found = checkpoint.Read(state, &faults, &error);
  if (found == Checkpoint::Found::OTHER_SETUP) {
    BadInput("--resume: " + error + "; give the same flags, or another --out");
  }
  if (found == Checkpoint::Found::NONE) {
    if (!faults.empty()) {
      std::string all;
      for (const std::string& fault : faults) all += fault + "; ";
      BadInput("--resume: " + all + "nothing to go on from");
    }
    std::printf("          no checkpoint in %s yet: from the beginning\n",
                FLAGS_out.c_str());
    return false;
  }
  for (const std::string& fault : faults) {
    std::printf("          %s: the one before is used\n", fault.c_str());
  }
  return true;
}

bool Resume(const Checkpoint& checkpoint,
            const std::function<void(const Json&)>& read) {
  Json state;
  if (!Resume(checkpoint, &state)) return false;
  try {
    read(state);
  } catch (const Json::exception& exception) {
    RefuseState(checkpoint, exception);
  }
  return true;
}

void RefuseState(const Checkpoint& checkpoint,
                 const Json::exception& exception) {
  BadInput("--resume: " + checkpoint.path() +
           ": not a checkpoint of this version: " + exception.what());
}

namespace {

template <typename T>
Json Written(const T& state) {
  Writer writer;
  Fields(writer, state);
  return writer.Take();
}

template <typename T>
T ReadFrom(const Json& json) {
  T state;
  Reader reader(json);
  Fields(reader, state);
  return state;
}

}  // namespace

Json ToJson(const JammingState& state) { return Written(state); }
JammingState JammingStateOf(const Json& json) {
  return ReadFrom<JammingState>(json);
}

Json ToJson(const RelaxationState& state) { return Written(state); }
RelaxationState RelaxationStateOf(const Json& json) {
  return ReadFrom<RelaxationState>(json);
}

Json ToJson(const FlowState& state) { return Written(state); }
FlowState FlowStateOf(const Json& json) { return ReadFrom<FlowState>(json); }

Json ToJson(const QuasistaticShearState& state) { return Written(state); }
QuasistaticShearState ShearStateOf(const Json& json) {
  return ReadFrom<QuasistaticShearState>(json);
}

Json ToJson(const StressShearState& state) { return Written(state); }
StressShearState StressShearStateOf(const Json& json) {
  return ReadFrom<StressShearState>(json);
}

void CatchStopSignals() {
  std::signal(SIGINT, NoteStop);
  std::signal(SIGTERM, NoteStop);
}

bool StopRequested() { return stop_requested != 0; }

}  // namespace granopt
