#include "experiments/jobs.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <utility>

#include "solvers/format.h"

namespace granopt {
namespace {

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// What a child that could not become its program says to its parent.
constexpr int kNoLog = 126;
constexpr int kNoProgram = 127;

// Starts the job with the signal mask `mask`; -1 and errno if there is no
// process to be had. The write end of a pipe that exec closes carries errno of
// what fails in the child.
pid_t Start(const Job& job, const sigset_t& mask, int* failure) {
  *failure = 0;
  int channel[2];
  if (pipe2(channel, O_CLOEXEC) != 0) {
    *failure = errno;
    return -1;
  }
  // Everything that allocates is done before the fork.
  std::vector<std::string> words = job.arguments;
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  std::fflush(nullptr);
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child < 0) {
    *failure = errno;
    close(channel[0]);
    close(channel[1]);
    return -1;
  }
  if (child == 0) {
    const auto fail = [&channel](int status) {
      const int code = errno;
      // Nothing to be done if the parent is gone.
      if (write(channel[1], &code, sizeof(code)) < 0) _exit(status);
      _exit(status);
    };
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(kNoProgram);
    const int in = open("/dev/null", O_RDONLY);
    const int out =
        open(job.log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (in < 0 || out < 0) fail(kNoLog);
    if (dup2(in, STDIN_FILENO) < 0 || dup2(out, STDOUT_FILENO) < 0 ||
        dup2(out, STDERR_FILENO) < 0) {
      fail(kNoLog);
    }
    sigprocmask(SIG_SETMASK, &mask, nullptr);
    execv(job.program.c_str(), argv.data());
    fail(kNoProgram);
  }
  // Here too, so that no signal comes between.
  setpgid(child, child);
  close(channel[1]);
  int code = 0;
  ssize_t got;
  do {
    got = read(channel[0], &code, sizeof(code));
  } while (got < 0 && errno == EINTR);
  close(channel[0]);
  if (got == static_cast<ssize_t>(sizeof(code))) {
    *failure = code;
    waitpid(child, nullptr, 0);
    return -1;
  }
  return child;
}

}  // namespace

const char kThisProgram[] = "/proc/self/exe";

std::string Describe(const JobOutcome& outcome) {
  switch (outcome.state) {
    case JobOutcome::NOT_STARTED:
      return "not started";
    case JobOutcome::EXITED:
      return Format("exit status %d", outcome.status);
    case JobOutcome::KILLED:
      return Format("killed by signal %d", outcome.status);
    case JobOutcome::FAILED_TO_START:
      return std::string("cannot be started: ") + std::strerror(outcome.status);
  }
  return "unknown";
}

std::vector<JobOutcome> RunJobs(
    const std::vector<Job>& jobs,
    int at_once,
    const std::function<void(const JobProgress&)>& observer,
    bool* interrupted) {
  std::vector<JobOutcome> outcomes(jobs.size());
  struct Running {
    pid_t process;
    std::size_t job;
    Clock::time_point start;
  };
  std::vector<Running> running;
  JobProgress progress;
  progress.total = static_cast<int>(jobs.size());
  *interrupted = false;
  double total = 0.0, done = 0.0;  // weights
  for (const Job& job : jobs) total += job.weight;
  // Blocked, signals wait for sigtimedwait(), which has no races.
  sigset_t awaited, before;
  sigemptyset(&awaited);
  for (const int signal : {SIGINT, SIGTERM, SIGCHLD}) {
    sigaddset(&awaited, signal);
  }
  sigprocmask(SIG_BLOCK, &awaited, &before);
  const Clock::time_point start = Clock::now();
  const auto report = [&] {
    progress.running = static_cast<int>(running.size());
    progress.seconds = SecondsSince(start);
    progress.seconds_left =
        done > 0.0 ? progress.seconds * (total - done) / done : 0.0;
    progress.interrupted = *interrupted;
    if (observer) observer(progress);
  };
  std::size_t next = 0;
  while (true) {
    while (!*interrupted && next < jobs.size() &&
           static_cast<int>(running.size()) < at_once) {
      int failure = 0;
      const pid_t process = Start(jobs[next], before, &failure);
      if (process < 0) {
        outcomes[next].state = JobOutcome::FAILED_TO_START;
        outcomes[next].status = failure;
        ++progress.done;
      } else {
        running.push_back({process, next, Clock::now()});
      }
      ++next;
    }
    if (running.empty()) break;
    timespec wait = {0, 200000000};
    const int signal = sigtimedwait(&awaited, nullptr, &wait);
    if (signal == SIGINT || signal == SIGTERM) {
      *interrupted = true;
      for (const Running& child : running) kill(child.process, signal);
    }
    // One SIGCHLD may stand for several ends.
    for (std::size_t r = 0; r < running.size();) {
      int status = 0;
      if (waitpid(running[r].process, &status, WNOHANG) != running[r].process) {
        ++r;
        continue;
      }
      JobOutcome& outcome = outcomes[running[r].job];
      outcome.seconds = SecondsSince(running[r].start);
      const bool exited = WIFEXITED(status);
      outcome.state = exited ? JobOutcome::EXITED : JobOutcome::KILLED;
      outcome.status = exited ? WEXITSTATUS(status) : WTERMSIG(status);
      ++progress.done;
      done += jobs[running[r].job].weight;
      running.erase(running.begin() + static_cast<std::ptrdiff_t>(r));
    }
    report();
  }
  sigprocmask(SIG_SETMASK, &before, nullptr);
  return outcomes;
}

}  // namespace granopt
