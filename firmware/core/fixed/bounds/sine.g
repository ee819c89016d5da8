# sine() of angle.h against its minimax polynomial in exact arithmetic; x in quarter turns.
# Integers stand as the real numbers they mean. dn: rounded down (a shift), ne: to nearest.
# Bound: the evaluation adds less than 1.9e-9. The polynomial itself is within 1.5e-11 of the sine
# (tests/firmware/test_bounds.py), together less than the 2.0e-9 that angle.h states.
x = fixed<-30,ne>(X);
z = x * x;
r = fixed<-31,dn>(z);
y = r - e;   # e: the last unit is taken off where x is +-1
t5 = -117449b-35 * y;
f4 = fixed<-34,dn>(t5);
s4 = 2752512b-34 + f4;
t4 = s4 * y;
f3 = fixed<-33,dn>(t4);
s3 = -40214812b-33 + f3;
t3 = s3 * y;
f2 = fixed<-32,dn>(t3);
s2 = 342277057b-32 + f2;
t2 = s2 * y;
f1 = fixed<-31,dn>(t2);
s1 = -1387197326b-31 + f1;
t1 = s1 * y;
f0 = fixed<-30,dn>(t1);
s0 = 1686629713b-30 + f0;
t0 = s0 * x;
s = fixed<-30,ne>(t0);

P4 = 0.00016021724632739244 + z * -3.4182130493905245e-06;
P3 = -0.004681620350775654 + z * P4;
P2 = 0.07969258733501738 + z * P3;
P1 = -0.6459640926526928 + z * P2;
P0 = 1.570796326621876 + z * P1;

{ x in [-1,1] /\ e in [0,1b-31] -> s - P0 * x in [-1.9e-9,1.9e-9] }

y - z -> (r - z) - e;
s4 - P4 -> (2752512b-34 - 0.00016021724632739244) + (f4 - t5)
  + ((-117449b-35 - -3.4182130493905245e-06) * y + -3.4182130493905245e-06 * (y - z));
s3 - P3 -> (-40214812b-33 - -0.004681620350775654) + (f3 - t4) + ((s4 - P4) * y + P4 * (y - z));
s2 - P2 -> (342277057b-32 - 0.07969258733501738) + (f2 - t3) + ((s3 - P3) * y + P3 * (y - z));
s1 - P1 -> (-1387197326b-31 - -0.6459640926526928) + (f1 - t2) + ((s2 - P2) * y + P2 * (y - z));
s0 - P0 -> (1686629713b-30 - 1.570796326621876) + (f0 - t1) + ((s1 - P1) * y + P1 * (y - z));
s - P0 * x -> (s - t0) + (s0 - P0) * x;
