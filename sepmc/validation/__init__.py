"""Why a number may be trusted: closed forms and classical formulations, and the engine held against
them."""
