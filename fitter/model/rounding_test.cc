#include "fitter/model/rounding.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace armtrue {
namespace {

TEST(Rounding, FindsTheCoarsestStepOfAllValues_ElseZero) {
  EXPECT_EQ(step_of_lengths(std::vector<double>{1.2345, -0.3, 2.7101}).words, "0.1 mm");
  EXPECT_EQ(step_of_lengths(std::vector<double>{1234.5 * 1e-3, 0.01 * 1e-3}).words, "0.01 mm");
  EXPECT_EQ(step_of_lengths(std::vector<double>{1.23456789, 0.1}).size, 0.0);
  std::vector<double> angles;
  for (const double degrees : {12.34, -170.01, 55.5})
    angles.push_back(degrees * std::numbers::pi / 180.0);
  EXPECT_EQ(step_of_angles(angles).words, "0.01 deg");
  EXPECT_NEAR(step_of_angles(angles).sigma(), 50.4e-6, 1e-7);
  angles.push_back(0.123456789);
  EXPECT_EQ(step_of_angles(angles).size, 0.0);
  EXPECT_EQ(step_of_angles({}).size, 0.0);
}

}  // namespace
}  // namespace armtrue
