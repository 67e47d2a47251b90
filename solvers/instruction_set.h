// granopt: which of several compiled kernels this machine can run.

#ifndef GRANOPT_SOLVERS_INSTRUCTION_SET_H_
#define GRANOPT_SOLVERS_INSTRUCTION_SET_H_

namespace granopt {

enum class InstructionSet {
  PORTABLE,  // SSE2 on x86-64, else what the compiler takes by itself
  AVX2,      // and FMA
  AVX512,    // F, VL and DQ
};

inline bool Runs(InstructionSet set) {
#ifdef __x86_64__
  __builtin_cpu_init();
  switch (set) {
    case InstructionSet::PORTABLE:
      return true;
    case InstructionSet::AVX2:
      return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    case InstructionSet::AVX512:
      return __builtin_cpu_supports("avx512f") &&
             __builtin_cpu_supports("avx512vl") &&
             __builtin_cpu_supports("avx512dq");
  }
  return false;
#else
  return set == InstructionSet::PORTABLE;
#endif
}

}  // namespace granopt

#endif  // GRANOPT_SOLVERS_INSTRUCTION_SET_H_
