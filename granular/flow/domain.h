// granopt: what happens at the boundary of a flow.

#ifndef GRANOPT_GRANULAR_FLOW_DOMAIN_H_
#define GRANOPT_GRANULAR_FLOW_DOMAIN_H_

namespace granopt {

// A cube of side `side` centred at 0, or none.
struct Domain {
  enum class Kind {
    // No boundary.
    OPEN,
    // The paper's rule (sec. 7): where a coordinate of an outgoing grain is
    // beyond the boundary, r_x -> -r_x, velocity kept. Forces and contacts know
    // no images, so that a jump changes the potential energy.
    REENTRY,
    // Periodic, forces and contacts with the nearest image: a jump changes
    // nothing.
    NEAREST_IMAGE,
    // Elastic walls at the centres' +-side / 2: an outgoing velocity component
    // is reversed, the position kept.
    WALLS,
  };
  Kind kind = Kind::OPEN;
  double side = 1.0;

  // Of the nearest image, 0 without images.
  double period() const { return kind == Kind::NEAREST_IMAGE ? side : 0.0; }
};

// "open", "paper", "periodic", "walls".
const char* DomainName(Domain::Kind kind);
// False for another word.
bool ParseDomain(const char* word, Domain::Kind* kind);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_DOMAIN_H_
