"""What a policy is to do, for one robot or a batch of them: where it starts, its reward, and when it has failed.

Single, vector and `dm_env` environments, training and regression all judge a policy step with the functions of this
package. Everything takes and returns arrays `(..., n)`; nothing simulates and nothing is random but the numbers that a
caller hands in.
"""
