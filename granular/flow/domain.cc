#include "granular/flow/domain.h"

#include <cstring>

namespace granopt {

namespace {

constexpr Domain::Kind kKinds[] = {Domain::Kind::OPEN,
                                   Domain::Kind::REENTRY,
                                   Domain::Kind::NEAREST_IMAGE,
                                   Domain::Kind::WALLS};

}  // namespace

const char* DomainName(Domain::Kind kind) {
  switch (kind) {
    case Domain::Kind::OPEN:
      return "open";
    case Domain::Kind::REENTRY:
      return "paper";
    case Domain::Kind::NEAREST_IMAGE:
      return "periodic";
    case Domain::Kind::WALLS:
      return "walls";
  }
  return "";
}

bool ParseDomain(const char* word, Domain::Kind* kind) {
  for (const Domain::Kind known : kKinds) {
    if (std::strcmp(word, DomainName(known)) != 0) continue;
    *kind = known;
    return true;
  }
  return false;
}

}  // namespace granopt
