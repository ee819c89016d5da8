#include "firmware/core/evaluation/inverse.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "firmware/core/table/table.h"
#include "firmware/core/table/test_image.h"

namespace armtrue {
namespace {

// One joint, of which x is known exactly: x + offset + steep(x) + smooth(x) = target. Every term
// must see the link where the ones before it have moved it.
TEST(InverseTest, TermsOfALink_AreThoseOfWhereItStands) {
  constexpr double kOffset = 5e-3;
  constexpr double kSteep = 1e-2;   // amplitude of sin 15 x; 0.75 mrad of it over the offset
  constexpr double kSmooth = 1e-3;  // times sin 2 x
  tests::TestImage made(1);
  made.add_constant(0, kOffset);
  made.add_harmonic(0, format::node::kLinkAngle, 15.0, 0.0, kSteep);
  made.add_harmonic(0, format::node::kLinkAngle, 2.0, 0.0, kSmooth);
  tests::put(made.header(), format::header::kSteepHarmonicsAt, std::uint16_t{1});
  const tests::Bytes image = made.image();
  ASSERT_TRUE(validate(image, {}).accepted());
  const auto work = std::make_unique<Workspace>();
  const Correction correction = solve(TableView(image), {}, {}, *work);
  double x = 0.0;
  for (int i = 0; i < 100; ++i) {
    x = -kOffset - kSteep * std::sin(15.0 * x) - kSmooth * std::sin(2.0 * x);
  }
  constexpr double kUnits = 4294967296.0 / (2.0 * M_PI);
  EXPECT_NEAR(correction.delta[0], x * kUnits, 100);
}

}  // namespace
}  // namespace armtrue
