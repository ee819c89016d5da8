# power_of_two() of terms.cc on 0 … 1: Horner's scheme in Q30, each product rounded.
# P: the same polynomial in exact arithmetic; it is within 2.7e-9 of 2^x (tests/firmware/test_bounds.py).
x = fixed<-30,ne>(X);
s5 = fixed<-30,ne>(235034b-30 * x) + 1329754b-30;
t4 = s5 * x;
f4 = fixed<-30,ne>(t4);
s4 = f4 + 10399164b-30;
t3 = s4 * x;
f3 = fixed<-30,ne>(t3);
s3 = f3 + 59571434b-30;
t2 = s3 * x;
f2 = fixed<-30,ne>(t2);
s2 = f2 + 257945589b-30;
t1 = s2 * x;
f1 = fixed<-30,ne>(t1);
s1 = f1 + 744260843b-30;
t0 = s1 * x;
f0 = fixed<-30,ne>(t0);
s0 = f0 + 1073741827b-30;

P5 = 235034b-30 * x + 1329754b-30;
P4 = P5 * x + 10399164b-30;
P3 = P4 * x + 59571434b-30;
P2 = P3 * x + 257945589b-30;
P1 = P2 * x + 744260843b-30;
P0 = P1 * x + 1073741827b-30;

{ x in [0,1] -> s0 - P0 in [-2.8e-9,2.8e-9] }

s4 - P4 -> (f4 - t4) + (s5 - P5) * x;
s3 - P3 -> (f3 - t3) + (s4 - P4) * x;
s2 - P2 -> (f2 - t2) + (s3 - P3) * x;
s1 - P1 -> (f1 - t1) + (s2 - P2) * x;
s0 - P0 -> (f0 - t0) + (s1 - P1) * x;
